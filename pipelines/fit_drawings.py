"""The paper's own case: an unordered folder of drawings and a puppet; no tracking, one canvas.

drawings + puppet -> place -> hinges -> search -> choose -> weigh -> fit -> exposure, meshes, preview -> OUT
"""

import numpy as np

from wildpuppet import stages
from wildpuppet.runs import check_out
from wildpuppet.store import given

from .fit_frames import Frames, fit_frames, with_learnt_hinges
from .keeper import Keeper
from .outcome import Outcome
from .request import Request, given_cutout, given_drawings


def fit_drawings(keeper: Keeper, request: Request) -> Outcome:
    """Run every stage that is not kept. Frames are numbered in sorted file order."""
    check_out(request.out)
    assert request.puppet is not None, "drawings need a puppet"
    drawings = given_drawings(request.source)
    puppet = keeper.keep(stages.PUPPET, cutout=given_cutout(request.puppet))
    folder = drawings.derived("folder", lambda found: found.folder)
    crops = keeper.keep(stages.DRAWINGS, folder=folder)
    names = drawings.value.names
    test = list(request.test_frames) or held_out(len(names), request.test_share, request.settings.train.seed)
    puppet = with_learnt_hinges(keeper, puppet, crops)
    fit = fit_frames(keeper, puppet, crops, Frames(len(names), None, test))
    no_clip = given(None, "none")
    numbers = keeper.keep(stages.REUSE, crops=crops)
    exposure = keeper.keep(stages.EXPOSURE, clip=no_clip, crops=crops, fit=fit, numbers=numbers)
    meshes = keeper.keep(stages.MESHES, clip=no_clip, puppet=puppet, crops=crops, fit=fit)
    preview = None
    if keeper.settings.out.preview:
        preview = keeper.keep(stages.PREVIEW, source=folder, puppet=puppet, crops=crops, fit=fit)
    size = drawings.value.size
    return Outcome(size, puppet, crops, fit, numbers, exposure, meshes, preview, names, tuple(test))


def held_out(number: int, share: float, seed: int) -> list[int]:
    """Choose the drawings that no training sees: ``share`` of them, drawn with ``seed``, in order."""
    count = min(round(share * number), number - 1)
    chosen = np.random.default_rng(seed).permutation(number)[:count]
    return sorted(int(index) for index in chosen)
