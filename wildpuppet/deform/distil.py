"""Fit, distil, refit: a network that learnt from a clip's fits reads every frame, and from there all is fitted again.

The network sees each frame by itself and learns from all of them, doubtful ones but little: where the search took one
limb for another in a few drawings, what it reads is what the others say (measured: docs/accuracy.md).
"""

from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float

from wildpuppet.deform.lesson import LEAST_FRAMES, taught_frames
from wildpuppet.deform.model import Model
from wildpuppet.deform.teach import OURS, taught
from wildpuppet.machine import Machine
from wildpuppet.pose.pieces import pieces_of
from wildpuppet.pose.similarity import similarities
from wildpuppet.settings import DistilSettings
from wildpuppet.types import Crops, Fit, Poses, Puppet

MOST_DRAWINGS = 400
"""Drawings that are learnt from, evenly chosen; their pictures are held in memory."""
READ = 0.1
"""Share of the progress that reading the frames takes."""


def distil(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    fit: Fit,
    settings: DistilSettings,
    machine: Machine,
    checkpoint: Path | None = None,
) -> Poses:
    """Train our network on ``fit`` (with its confidence) and give the poses that it reads in every frame.

    Draw orders, costs and margins stay those of ``poses``; so do the poses where the character is lost, and all of
    them where there are too few drawings to learn from. Raises StoreError as ``taught`` does.
    """
    rows = taught_frames(crops, fit, np.zeros(0, np.int64))
    if len(rows) < LEAST_FRAMES:
        return poses
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_DRAWINGS)).round().astype(np.int64)]
    train = msgspec.structs.replace(OURS, iterations=settings.iterations, seed=settings.seed)
    total = round(train.iterations / (1 - READ))

    def tell(done: int, _: int, losses: dict[str, float]) -> None:
        machine.progress(done, total)

    model = taught(puppet, crops, fit, rows, train, checkpoint=checkpoint, tell=tell)
    maps = as_poses(puppet, np.concatenate([_read(model, crops, index) for index in range(len(crops.frames))]))
    machine.progress(total, total)
    is_lost = np.array(crops.state) == "lost"
    kept = np.where(is_lost[:, None, None, None], poses.crop_from_canvas, maps)
    return Poses(kept, poses.order, poses.cost, poses.margin)


def as_poses(puppet: Puppet, vertices: Float[np.ndarray, "T V 2"]) -> Float[np.ndarray, "T P 2 3"]:
    """Read off each piece's similarity (crop from canvas)."""
    pieces = pieces_of(puppet)
    return similarities(pieces.puppet, vertices[:, pieces.vertex])


def _read(model: Model, crops: Crops, index: int) -> Float[np.ndarray, "1 V 2"]:
    return model.decode(model.encode(crops.images[index : index + 1]))
