"""RGBA layers as video: ProRes 4444 (.mov, editors) or VP9 (.webm, browsers), one file per part and one of all.

Straight alpha, BT.709, limited range, tagged. The parts are drawn whole, not cut by what covers them.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Int, UInt8

from wildpuppet.export.animation import Animation
from wildpuppet.export.draw import Painter
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.export.png import COMBINED, left_out
from wildpuppet.machine import Progress
from wildpuppet.video.alpha import write_alpha

Kind = Literal["prores", "webm"]
SUFFIX: dict[Kind, str] = {"prores": ".mov", "webm": ".webm"}


def write_kind(animation: Animation, folder: Path, options: Options, progress: Progress, kind: Kind) -> Manifest:
    """Write FOLDER/combined.mov and FOLDER/layers/PART.mov (or .webm)."""
    painter, total = Painter(animation), (animation.puppet.num_layers + 1) * len(animation)
    stems = [COMBINED, *(f"layers/{name}" for name in file_names(animation.puppet.names))]
    pts, time_base = _times(animation)
    for place, stem in enumerate(stems):
        pictures = painter.pictures(place - 1 if place else None)
        counted = _counted(pictures, progress, place * len(animation), total)
        write_alpha(folder / f"{stem}{SUFFIX[kind]}", counted, pts, time_base, kind)
    words = [*left_out(animation, has_times=True)]
    if kind == "webm":
        words.append("exact times: WebM counts milliseconds; colour: one sample per 2 x 2 pixels (4:2:0)")
    if options.first_frame is not None:
        words.append("the number of the first frame: a video begins at 0")
    return Manifest("top left corner of the picture", "x right, y down", 0, left_out=tuple(words))


def _times(animation: Animation) -> tuple[Int[np.ndarray, "T"], Fraction]:
    """Whole ticks of one frame where the rate is even, else the clip's own."""
    timing = animation.timing
    if timing.is_variable:
        return timing.pts, timing.time_base
    return np.arange(len(animation), dtype=np.int64), 1 / timing.rate


def _counted(
    pictures: Iterable[UInt8[np.ndarray, "H W 4"]], progress: Progress, done: int, total: int
) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
    for number, picture in enumerate(pictures, done + 1):
        yield picture
        progress(number, total)
