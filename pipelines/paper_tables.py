"""The methods of the paper's tables on one benchmark set: what each needs, trains and answers.

Every method answers for the set's test drawings: a picture of each (Table 1) and its points in each of the others
(Table 2). An answer is kept in OUT/sets/SET/METHOD, with the seed behind it where chance plays a part, and not made
again as long as the set's files, the settings and the versions of the stages stay the same.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from wildpuppet.errors import WildPuppetError
from wildpuppet.machine import Machine
from wildpuppet.settings import RefineSettings, Settings
from wildpuppet.stages import STAGES
from wildpuppet.store import digest_of

from .paper_work import SetWork, ours_settings, paper_refine_settings, paper_settings, refine_settings
from .reporter import progress_of

if TYPE_CHECKING:
    from wildpuppet.api import Run
    from wildpuppet.tables.answer import Answer

VERSION = 1
"""Raised when an answer is made differently from the same files and settings."""


@dataclass(frozen=True)
class Method:
    """A row of the tables. ``depends`` gives what the answer depends on beside the set's files and the seed."""

    name: str
    answer: "Callable[[SetWork, int], Answer]"
    depends: Callable[[SetWork], object]
    is_random: bool = False


def _reference(work: SetWork, seed: int) -> "Answer":
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.pairs import copied

    return Answer(tuple(work.drawings[work.truth.reference] for _ in work.test), copied(work.points))


def _flow(work: SetWork, seed: int) -> "Answer":
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.flow import carried_by_flow, warped_by_flow

    known = work.drawings[work.truth.reference]
    pictures = tuple(warped_by_flow(known, wanted) for wanted in work.tested)
    return Answer(pictures, carried_by_flow(work.tested, work.points))


def _flow_of_nearest(work: SetWork, seed: int) -> "Answer":
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.flow import nearest, warped_by_flow

    known = [work.trained[nearest(work.trained, wanted)] for wanted in work.tested]
    return Answer(tuple(warped_by_flow(source, wanted) for source, wanted in zip(known, work.tested, strict=True)))


def _autoencoder(work: SetWork, seed: int) -> "Answer":
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.deforming import (
        carried_by_warps,
        load_deforming,
        read_deforming,
        save_deforming,
        train_deforming,
    )

    path = work.out / "autoencoders" / f"{work.case.name}-{seed}.safetensors"
    identity = digest_of([VERSION, work.content, seed, work.effort.autoencoder_steps])
    network = load_deforming(path, identity)
    if network is None:
        machine = Machine(progress=progress_of(work.reporter))
        work.reporter.begin("auto-encoder")
        network = train_deforming(work.trained, seed, machine, work.effort.autoencoder_steps)
        save_deforming(path, network, identity)
        work.reporter.end("auto-encoder", False)
    readings = [read_deforming(network, drawing) for drawing in work.tested]
    return Answer(tuple(reading.picture for reading in readings), carried_by_warps(readings, work.points))


def _paper(work: SetWork, seed: int) -> "Answer":
    return _of_run(work, work.ran(f"paper-{seed}", paper_settings(work, seed)), None)


def _ours(work: SetWork, seed: int) -> "Answer":
    return _of_run(work, work.ran("ours", ours_settings(work)), None)


def _ours_named(work: SetWork, seed: int) -> "Answer":
    answer = _of_run(work, work.ran("ours", ours_settings(work)), work.truth.part.astype(np.int64))
    return replace(answer, pictures=None)


def _paper_refined(work: SetWork, seed: int) -> "Answer":
    run = work.ran(f"paper-{seed}", paper_settings(work, seed))
    return _refined(work, run, f"paper-{seed}", paper_refine_settings(work, seed))


def _ours_dressed(work: SetWork, seed: int) -> "Answer":
    return _refined(work, work.ran("ours", ours_settings(work)), "texture", RefineSettings(method="texture"))


def _ours_refined(work: SetWork, seed: int) -> "Answer":
    return _refined(work, work.ran("ours", ours_settings(work)), f"ours-{seed}", refine_settings(work, seed))


def _refined(work: SetWork, run: "Run", name: str, settings: RefineSettings) -> "Answer":
    """Learn the look of the other drawings, then draw the test drawings' poses with it."""
    from wildpuppet.refine.refiner import refine_pictures
    from wildpuppet.refiners import refiner_of_run
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.error import on_white

    machine = Machine(work.options.device, progress=progress_of(work.reporter))
    work.reporter.begin("refine")
    folder = work.out / "refiners" / f"{work.case.name}-{name}"
    refiner = refiner_of_run(run, settings, machine, work.test.tolist(), folder)
    work.reporter.end("refine", False)
    poses, order = run.fit.vertices_crop[work.test], run.fit.order[work.test]
    found = refine_pictures(refiner, poses, order, run.size, run.crops.video_from_crop[work.test])
    return Answer(tuple(on_white(picture) for picture in found))


def _of_run(work: SetWork, run: "Run", layers: "np.ndarray | None") -> "Answer":
    from wildpuppet.export.draw import Painter
    from wildpuppet.export.source import over_white
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.pairs import carried_by_puppet

    painter, animation = Painter(run.animation), run.animation
    pictures = tuple(over_white(painter.picture(animation[int(index)])) for index in work.test)
    return Answer(pictures, carried_by_puppet(run.puppet, run.crops, run.fit, work.test, work.points, layers))


def stages_of(settings: Callable[[SetWork], Settings]) -> Callable[[SetWork], object]:
    """Say what a run's answers depend on: its settings and the versions of the stages."""

    def depends(work: SetWork) -> object:
        versions = {stage.name: stage.version for stage in STAGES}
        tree = msgspec.to_builtins(settings(work))
        del tree["out"]  # which files are written beside
        return [tree, versions]

    return depends


def _of_refinement(
    settings: Callable[[SetWork], Settings], refine: Callable[[SetWork], RefineSettings]
) -> Callable[[SetWork], object]:
    return lambda work: [stages_of(settings)(work), msgspec.to_builtins(refine(work))]


def _on_nothing(work: SetWork) -> object:
    return None


METHODS = (
    Method("copy", _reference, _on_nothing),
    Method("flow warp", _flow, _on_nothing),
    Method("flow warp of nearest", _flow_of_nearest, _on_nothing),
    Method("auto-encoder", _autoencoder, lambda work: work.effort.autoencoder_steps, is_random=True),
    Method("paper", _paper, stages_of(paper_settings), is_random=True),
    Method("paper, refined", _paper_refined, _of_refinement(paper_settings, paper_refine_settings), is_random=True),
    Method("ours", _ours, stages_of(ours_settings)),
    Method("ours, texture of nearest", _ours_dressed, stages_of(ours_settings)),
    Method("ours, refined", _ours_refined, _of_refinement(ours_settings, refine_settings), is_random=True),
    Method("ours, parts named", _ours_named, stages_of(ours_settings)),
)


def answered(work: SetWork, method: Method, seed: int) -> "Answer | str":
    """Give a method's answer, kept or new; where it fails for a reason in words, give the reason."""
    from wildpuppet.tables.answer import load_answer, save_answer

    label = method.name.replace(", ", "-").replace(" ", "-")
    folder = work.out / "sets" / work.case.name / (f"{label}-{seed}" if method.is_random else label)
    identity = digest_of([VERSION, work.content, method.name, seed, method.depends(work)])
    kept = load_answer(folder, identity)
    if kept is not None:
        return kept
    try:
        answer = method.answer(work, seed)
    except WildPuppetError as error:
        return str(error)
    save_answer(folder, answer, identity)
    return answer
