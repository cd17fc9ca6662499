"""The small, padded copy of each frame that tracking works on.

The character's larger side becomes about ``BOX_PIXELS``; a border of repeated edge pixels lets a box leave the frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import UInt8

from wildpuppet.track.trackers import Box
from wildpuppet.types import Clip, Target
from wildpuppet.video.read import FrameReader

# Larger is surer on small marks and slower (quadratic).
BOX_PIXELS = 112
# Border around the frame, as a share of the box's larger side: a box may leave the frame so far.
PADDING = 0.7
# Small copies of the whole range are kept from the first pass for the second when they take no more than this.
KEPT_BYTES = 160 * 2**20
# Frames decoded at once when walking backwards.
BLOCK_FRAMES = 48


@dataclass(frozen=True)
class Working:
    """The map between video pixels and working pixels: ``working = video * scale + pad``."""

    scale: tuple[float, float]
    size: tuple[int, int]
    pad: int

    def image(self, rgb: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """Shrink a frame, pad it and turn it to BGR."""
        small = cv2.resize(rgb, self.size, interpolation=cv2.INTER_AREA)
        padded = cv2.copyMakeBorder(small, self.pad, self.pad, self.pad, self.pad, cv2.BORDER_REPLICATE)
        return cv2.cvtColor(padded, cv2.COLOR_RGB2BGR)

    def inner(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "a b 3"]:
        """Take the padding off."""
        return np.ascontiguousarray(image[self.pad : image.shape[0] - self.pad, self.pad : image.shape[1] - self.pad])

    def box_in(self, box_video: Box) -> Box:
        """Take a box from video pixels to working pixels."""
        x, y, w, h = box_video
        sx, sy = self.scale
        return x * sx + self.pad, y * sy + self.pad, w * sx, h * sy

    def box_out(self, box: Box) -> Box:
        """Take a box from working pixels to video pixels."""
        x, y, w, h = box
        sx, sy = self.scale
        return (x - self.pad) / sx, (y - self.pad) / sy, w / sx, h / sy


def working_for(size: tuple[int, int], box_video: Box) -> Working:
    """Choose the working scale for a character of this size; frames are never enlarged."""
    side = max(box_video[2:])
    shrink = min(1.0, BOX_PIXELS / side)
    small = max(round(size[0] * shrink), 1), max(round(size[1] * shrink), 1)
    scale = small[0] / size[0], small[1] / size[1]
    return Working(scale, small, round(PADDING * side * shrink))


class Pictures:
    """The working copies of a range, decoded in blocks; a short range is kept, so that it is decoded once."""

    def __init__(self, clip: Clip, target: Target, working: Working) -> None:
        self.working = working
        self._reader = FrameReader(clip)
        size = 3 * (working.size[0] + 2 * working.pad) * (working.size[1] + 2 * working.pad)
        self._keeps = size * (target.end - target.start) <= KEPT_BYTES
        self._kept: dict[int, UInt8[np.ndarray, "h w 3"]] = {}

    def __getitem__(self, index: int) -> UInt8[np.ndarray, "h w 3"]:
        return next(self.forward(index, index + 1))[1]

    def forward(self, start: int, end: int) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Yield frames start .. end - 1 with their numbers."""
        if all(index in self._kept for index in range(start, end)):
            yield from ((index, self._kept[index]) for index in range(start, end))
            return
        for index, rgb in self._reader.frames(start, end):
            image = self.working.image(rgb)
            if self._keeps:
                self._kept[index] = image
            yield index, image

    def backward(self, start: int, end: int) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Yield frames end - 1 down to start, a block in memory at a time."""
        for block_end in range(end, start, -BLOCK_FRAMES):
            block = list(self.forward(max(start, block_end - BLOCK_FRAMES), block_end))
            yield from reversed(block)
