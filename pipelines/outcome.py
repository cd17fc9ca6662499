"""Writing OUT: which kept files become which files of the run's folder, and what run.json says."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from wildpuppet.export.exposure import exposures_of, summary_of
from wildpuppet.fit.advice import worth_a_look
from wildpuppet.runs import CARRY, write_run
from wildpuppet.store import Kept
from wildpuppet.types import Crops, Fit, Puppet

from .keeper import Keeper, stage_list
from .request import Request


@dataclass(frozen=True)
class Outcome:
    """What a run made. ``size`` (W, H) is the video's or the canvas's."""

    size: tuple[int, int]
    puppet: Kept[Puppet]
    crops: Kept[Crops]
    fit: Kept[Fit]
    numbers: Kept[Any]
    exposure: Kept[Path]
    meshes: Kept[Path]
    preview: Kept[Path] | None
    names: tuple[str, ...] = ()
    """File names of drawings, in the order of the frames."""
    test: tuple[int, ...] = ()
    """Frames that no training saw."""


def write_outcome(keeper: Keeper, request: Request, outcome: Outcome) -> None:
    """Write the run's folder from kept files."""
    run = {
        "request": request.plain(),
        "size": list(outcome.size),
        "names": list(outcome.names),
        "test": list(outcome.test),
        "stages": stage_list([used.question for used in keeper.used]),
        **_by_frame(outcome.fit.value),
        "exposure": summary_of(exposures_of(outcome.numbers.value, outcome.crops.value, outcome.fit.value)),
    }
    timings = {
        "schema": "wildpuppet.timings/1",
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "store": str(keeper.store.folder.absolute()),
        "device": keeper.machine.device,
        "threads": keeper.machine.num_threads,
        "seconds": keeper.seconds(),
        "made_now": sorted({used.question.stage for used in keeper.used if not used.is_kept}),
    }
    write_run(request.out, _sources(keeper, outcome), run, timings)


def _sources(keeper: Keeper, outcome: Outcome) -> dict[str, Path]:
    """Name in OUT -> file in the store."""
    carried = ((outcome.puppet, "puppet.npz"), (outcome.crops, "crops.npz"), (outcome.fit, "fit.npz"))
    sources = {f"{CARRY}/{name}": _folder(kept) / name for kept, name in carried}
    for kept in (outcome.exposure, outcome.meshes, outcome.preview):
        if kept is not None and kept.entry is not None:
            sources |= {name: kept.entry.folder / name for name in kept.entry.files}
    for used in keeper.used:
        if used.question.stage == "automatic":
            sources |= {name: used.entry.folder / name for name in used.entry.files}
    return sources


def _folder(kept: Kept[Any]) -> Path:
    assert kept.entry is not None, "results of stages have an entry"
    return kept.entry.folder


def _by_frame(fit: Fit) -> dict[str, Any]:
    """States and losses of every frame, and the frames to look at first."""
    return {
        "worth_a_look": worth_a_look(fit),
        "frames": [int(frame) for frame in fit.frames],
        "state": list(fit.state),
        "states": dict(sorted(Counter(fit.state).items())),
        "confidence": [round(float(value), 4) for value in fit.confidence.mean(axis=1)],
        "losses": {name: [_short(value) for value in values] for name, values in sorted(fit.losses.items())},
    }


def in_short(run: Mapping[str, Any]) -> str:
    """Say how many frames went how, and which to look at first; ``run`` is what run.json holds."""
    counts = ", ".join(f"{number} {state}" for state, number in run["states"].items())
    frames = ", ".join(str(frame) for frame in run.get("worth_a_look", ()))
    return f"{len(run['frames'])} frames, {counts}; most worth a look, least trusted first: {frames}"


def _short(value: Any) -> float | None:
    """Six significant digits; JSON has no word for what is not finite, so that becomes null."""
    number = float(value)
    return float(f"{number:.6g}") if abs(number) < float("inf") else None
