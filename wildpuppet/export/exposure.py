"""exposure.csv: the exposure sheet (dope sheet), one row per frame; what an animator reads timing from.

| column | what |
|---|---|
| ``frame`` | frame number of the clip, or of the drawing in file order |
| ``seconds``, ``seconds_exact`` | when it is shown: rounded to nanoseconds, and as a fraction; empty for drawings |
| ``drawing`` | 1, 2, ... in the order in which the distinct drawings first appear |
| ``frames_held`` | how many consecutive frames this exposure lasts: 1 on ones, 2 on twos, 3 on threes |
| ``first_frame`` | the frame that this exposure begins with |
| ``is_reused`` | true where the drawing comes back: its shot has shown it before, and others since |
| ``shot`` | 1, 2, ... |
| ``state`` | the fit's: fitted, held, doubtful or lost |

A lost frame shows no drawing of the character: its cells from ``drawing`` to ``is_reused`` are empty. An exposure that
reaches beyond the range of the run counts with the frames inside it.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from wildpuppet.export.whole import whole_file
from wildpuppet.types import Clip, Crops, Fit

COLUMNS = ("frame", "seconds", "seconds_exact", "drawing", "frames_held", "first_frame", "is_reused", "shot", "state")
NANOSECOND = 1_000_000_000


@dataclass(frozen=True)
class Exposure:
    """Consecutive frames that show one drawing: ``first`` is an index, ``drawing`` counts from 1; 0: no character."""

    first: int
    length: int
    drawing: int
    is_reused: bool


def exposures_of(numbers: Int[np.ndarray, "T"], crops: Crops, fit: Fit) -> list[Exposure]:
    """Cut the frames into exposures; ``numbers`` names each frame's drawing (see ``crop/reused.py``)."""
    drawings: dict[int, int] = {}
    keys = [
        (int(shot), 0 if state == "lost" else drawings.setdefault(int(number), len(drawings) + 1))
        for number, shot, state in zip(numbers, crops.shot, fit.state, strict=True)
    ]
    exposures: list[Exposure] = []
    for (_, drawing), group in groupby(range(len(keys)), keys.__getitem__):
        frames = list(group)
        is_reused = drawing > 0 and any(earlier.drawing == drawing for earlier in exposures)
        exposures.append(Exposure(frames[0], len(frames), drawing, is_reused))
    return exposures


def summary_of(exposures: list[Exposure]) -> dict[str, Any]:
    """Say in short how a shot is timed: distinct drawings, and the shares of the frames on ones, twos and threes."""
    shown = [exposure for exposure in exposures if exposure.drawing]
    frames = max(1, sum(exposure.length for exposure in shown))

    def share(*lengths: int) -> float:
        return round(sum(exposure.length for exposure in shown if exposure.length in lengths) / frames, 4)

    longest = max((exposure.length for exposure in shown), default=0)
    return {
        "drawings": len({exposure.drawing for exposure in shown}),
        "exposures": len(shown),
        "reused": sum(exposure.is_reused for exposure in shown),
        "ones": share(1),
        "twos": share(2),
        "threes": share(3),
        "longer": share(*range(4, longest + 1)),
    }


def write_exposure(path: Path, numbers: Int[np.ndarray, "T"], crops: Crops, fit: Fit, clip: Clip | None = None) -> None:
    """Write ``path`` (exposure.csv); ``clip`` gives the frames' times. Raises StoreError where the disk refuses."""
    with whole_file(path) as beside, beside.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_rows(exposures_of(numbers, crops, fit), crops, fit, clip))


def _rows(exposures: list[Exposure], crops: Crops, fit: Fit, clip: Clip | None) -> Iterator[tuple[Any, ...]]:
    for exposure in exposures:
        first = int(fit.frames[exposure.first])
        shown = (exposure.drawing, exposure.length, first, "true" if exposure.is_reused else "false")
        for index in range(exposure.first, exposure.first + exposure.length):
            frame = int(fit.frames[index])
            cells = shown if exposure.drawing else ("",) * len(shown)
            yield (frame, *_times(clip, frame), *cells, int(crops.shot[index]) + 1, fit.state[index])


def _times(clip: Clip | None, frame: int) -> tuple[str, str]:
    if clip is None:
        return "", ""
    seconds = int(clip.pts[frame]) * clip.time_base
    return _decimal(seconds), str(seconds)


def _decimal(seconds: Fraction) -> str:
    """Write a fraction in nine decimals."""
    whole, rest = divmod(abs(round(seconds * NANOSECOND)), NANOSECOND)
    return f"{'-' if seconds < 0 else ''}{whole}.{rest:09d}"
