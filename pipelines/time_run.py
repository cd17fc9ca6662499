"""How fast a run was: frames per second by stage, beside dense optical flow over the same frames."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wildpuppet.runs import TIMINGS, read_run
from wildpuppet.stages import NAMES
from wildpuppet.store import read_json

from .request import Request, request_from


def stage_lines(folder: Path) -> list[str]:
    """Tabulate what each stage of a run took when its results were made."""
    num_frames = len(read_run(folder)["frames"])
    seconds = stage_seconds(folder)
    whole = {**seconds, "all": sum(seconds.values())}
    lines = ["", f"{'stage':<10}{'seconds':>9}{'frames per second':>20}   {num_frames} frames of {folder}"]
    return lines + [f"{name:<10}{took:>9.1f}{num_frames / max(took, 1e-3):>20.2f}" for name, took in whole.items()]


def stage_seconds(folder: Path) -> dict[str, float]:
    """Read the seconds of each stage, in the order in which they run."""
    seconds: dict[str, float] = read_json(folder / TIMINGS)["seconds"]
    return {name: seconds[name] for name in NAMES if name in seconds}


def flow_lines(folder: Path) -> list[str]:
    """Time DIS optical flow from frame to frame over the run's frames, and say how many times longer the run took."""
    run = read_run(folder)
    request = request_from(run["request"], folder)
    if not request.source.exists():
        return [f"{request.source} is no longer there: no optical flow to compare with"]
    took, whole = flow_seconds(request, run), sum(stage_seconds(folder).values())
    speed = len(run["frames"]) / max(took, 1e-3)
    return [f"{'DIS flow':<10}{took:>9.1f}{speed:>20.2f}   the run took {whole / max(took, 1e-3):.0f} times as long"]


def flow_seconds(request: Request, run: Mapping[str, Any]) -> float:
    """Carry one point through the frames by DIS flow; reading them counts, as it does in the run."""
    import numpy as np

    from wildpuppet.correspond.baselines import flow_of_clip
    from wildpuppet.machine import Machine
    from wildpuppet.video.decode import over_white
    from wildpuppet.video.drawings import read_drawings
    from wildpuppet.video.probe import probe
    from wildpuppet.video.read import FrameReader

    points = np.array([[width / 2 for width in run["size"]]])
    if request.box_video is None:
        images, started = read_drawings(request.source)[1], time.monotonic()
        flow_of_clip((over_white(images[index : index + 1][0]) for index in range(len(images))), 0, points)
        return time.monotonic() - started
    with FrameReader(probe(request.source, request.settings.probe, Machine())) as reader:
        started = time.monotonic()
        flow_of_clip((picture for _, picture in reader.frames(run["frames"][0], run["frames"][-1] + 1)), 0, points)
        return time.monotonic() - started
