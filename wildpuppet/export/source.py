"""Where the pictures under a preview come from: the clip itself, or a folder of drawings."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int, UInt8

from wildpuppet.export.timing import DRAWINGS_RATE
from wildpuppet.types import Clip, Images
from wildpuppet.video.drawings import read_drawings
from wildpuppet.video.read import FrameReader
from wildpuppet.video.write import constant_times

Picture = UInt8[np.ndarray, "H W 3"]


@runtime_checkable
class Source(Protocol):
    """Pictures by frame number, and when each is shown."""

    def picture(self, frame: int) -> Picture:
        """Read one frame."""

    def times(self, frames: Int[np.ndarray, "T"]) -> tuple[Int[np.ndarray, "T"], Fraction]:
        """Give the frames' pts and their time base."""


class ClipSource:
    """Frames of a clip."""

    def __init__(self, clip: Clip) -> None:
        self._clip, self._reader = clip, FrameReader(clip)

    def picture(self, frame: int) -> Picture:
        """Read one frame; cheap in rising order."""
        return self._reader.frame(frame)

    def times(self, frames: Int[np.ndarray, "T"]) -> tuple[Int[np.ndarray, "T"], Fraction]:
        """Give the clip's own times."""
        return self._clip.pts[frames], self._clip.time_base


class DrawingSource:
    """Drawings of a folder over white paper."""

    def __init__(self, images: Images) -> None:
        self._images = images

    def picture(self, frame: int) -> Picture:
        """Read one drawing."""
        return over_white(self._images[frame : frame + 1][0])

    def times(self, frames: Int[np.ndarray, "T"]) -> tuple[Int[np.ndarray, "T"], Fraction]:
        """Give even times."""
        return constant_times(len(frames), DRAWINGS_RATE)


def source_of(place: Clip | Path) -> Source:
    """Open a clip or a folder of drawings."""
    if isinstance(place, Clip):
        return ClipSource(place)
    return DrawingSource(read_drawings(place)[1])


def pictures(source: Source, frames: Int[np.ndarray, "T"]) -> Iterator[Picture]:
    """Read frames one after the other."""
    for frame in frames:
        yield source.picture(int(frame))


def over_white(rgba: UInt8[np.ndarray, "H W 4"]) -> Picture:
    """Lay a straight-alpha picture over white."""
    alpha = rgba[..., 3:].astype(np.float32) / 255.0
    return np.asarray(np.round(rgba[..., :3] * alpha + 255.0 * (1.0 - alpha)), np.uint8)
