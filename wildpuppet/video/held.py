"""Recognise held drawings: cartoons show one drawing for two or three frames, under a camera that may move.

A frame repeats a drawing when no small block of the character changed. A pixel changed as far as its colour lies
outside the range of the 3x3 pixels at its place in the other frame, after the best global shift; so noise, a shift of
a part of a pixel, a slow zoom and the sampling of an edge do not count, while a mouth that opens does, however small.
Frames are compared with the first frame of the hold, not with the one before, so that slow motion adds up. What moves
by less than about a pixel from there does not count as a new drawing.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy import ndimage

from wildpuppet.types import Images

BLUR = 1.0
"""Standard deviation in pixels; keeps the encoder's noise and the sampling of fine detail from counting."""
BLOCK = 8
"""Side of the blocks, pixels. Smaller ones see smaller changes and more noise."""
LEAST_COVER = 0.25
"""Share of a block that must be character for it to count."""
CONTRAST_TOLERANCE = 0.15
"""Change allowed in a block, as a share of its local contrast; fine detail that is sampled anew changes so much."""
UNSURE, SURE = 0.55, 0.9
"""A pixel counts from the first matte on and fully from the second: what lies beyond the video's edge is unknown (0.5)
and changes with every move of the camera."""
LARGEST_SHIFT = 3.0
"""Largest global shift, pixels; held frames further off count as new, which only costs time."""
SHIFT_ROUNDS = 6
SHIFT_SOLVED = 0.02
AT_ONCE = 8
"""Images read at once."""


@dataclass(frozen=True, eq=False)
class _Picture:
    """A blurred crop and where its character may be (0 to 1)."""

    colour: Float[np.ndarray, "H W 3"]
    cover: Float[np.ndarray, "H W"]

    @property
    def grey(self) -> Float[np.ndarray, "H W"]:
        return np.asarray(self.colour.mean(-1))


def number_drawings(images: Images, shot: Int[np.ndarray, " T"], threshold: float) -> Int[np.ndarray, " T"]:
    """Number the distinct drawings from 0; frames with equal numbers follow one another and show the same drawing.

    ``threshold`` is the mean change (0..255) of a block that makes a new drawing, beyond what detail and noise
    explain; 1 to 3 is typical, lower takes more frames for new, 0 all of them. Pixels count by the matte (A); a frame
    without any character is a drawing of its own. A new shot starts a new drawing.
    """
    numbers = np.arange(len(shot), dtype=np.int64)
    if threshold <= 0.0:
        return numbers
    number, first = -1, None
    for start in range(0, len(shot), AT_ONCE):
        for offset, image in enumerate(images[start : start + AT_ONCE]):
            t = start + offset
            picture = _picture(image)
            if first is None or shot[t] != shot[t - 1] or not is_same_drawing(first, picture, threshold):
                number, first = number + 1, picture
            numbers[t] = number
    return numbers


def is_same_drawing(first: _Picture, second: _Picture, threshold: float) -> bool:
    """Tell whether the second frame shows the first one's drawing, shifted as a whole by a few pixels at most."""
    cover = ndimage.minimum_filter(np.maximum(first.cover, second.cover), 3)
    if ndimage.uniform_filter(cover, BLOCK).max() < LEAST_COVER:
        return False
    shift = _shift_between(first.grey, second.grey, cover)
    if np.abs(shift).max() >= LARGEST_SHIFT:
        return False
    return largest_change(first.colour, _shifted(second.colour, shift), cover) < threshold


def largest_change(
    first: Float[np.ndarray, "H W 3"], second: Float[np.ndarray, "H W 3"], cover: Float[np.ndarray, "H W"]
) -> float:
    """Give the largest mean change (0..255) of any block, less what its own contrast explains."""
    around = np.ones((3, 3), np.uint8)
    lowest, highest = cv2.erode(first, around), cv2.dilate(first, around)
    low, high = cv2.erode(second, around), cv2.dilate(second, around)
    outside = np.maximum(np.maximum(first - high, low - first), np.maximum(second - highest, lowest - second))
    contrast = np.maximum(highest - lowest, high - low)
    excess = np.maximum(outside, 0.0).mean(-1) - CONTRAST_TOLERANCE * contrast.mean(-1)
    covered = ndimage.uniform_filter(cover, BLOCK)
    change = ndimage.uniform_filter(excess * cover, BLOCK) / np.maximum(covered, LEAST_COVER)
    return float(np.where(covered >= LEAST_COVER, change, 0.0).max())


def _picture(rgba: UInt8[np.ndarray, "H W 4"]) -> _Picture:
    colour = ndimage.gaussian_filter(rgba[..., :3].astype(np.float32), (BLUR, BLUR, 0.0), truncate=3.0)
    matte = rgba[..., 3].astype(np.float32) / 255.0
    if matte.max() <= UNSURE:  # no matte was made: all of the picture counts
        return _Picture(colour, matte)
    return _Picture(colour, np.clip((matte - UNSURE) / (SURE - UNSURE), 0.0, 1.0))


def _shift_between(
    first: Float[np.ndarray, "H W"], second: Float[np.ndarray, "H W"], cover: Float[np.ndarray, "H W"]
) -> Float[np.ndarray, "2"]:
    """Find the (x, y) shift of the second picture that lays it on the first, by robust least squares.

    Pixels that no shift explains weigh less, by 1 / (1 + (error / 3 median errors)^2).
    """
    down, right = np.gradient(first)
    slopes = np.stack([right.ravel(), down.ravel()])
    shift = np.zeros(2)
    counts = cover.ravel() > 0.5 * cover.max()
    for _ in range(SHIFT_ROUNDS):
        error = (_shifted(second, shift) - first).ravel()
        scale = 3.0 * np.median(np.abs(error[counts])) + 1.0
        weighted = slopes * (cover.ravel() / (1.0 + (error / scale) ** 2))
        step = np.linalg.solve(weighted @ slopes.T + 1e-3 * np.eye(2), weighted @ error)
        shift = np.clip(shift + step, -LARGEST_SHIFT, LARGEST_SHIFT)
        if np.abs(step).max() < SHIFT_SOLVED:
            break
    return shift


def _shifted(values: Float[np.ndarray, "H W *C"], shift: Float[np.ndarray, "2"]) -> Float[np.ndarray, "H W *C"]:
    """Move a picture by (x, y) pixels, bilinear, its border repeated."""
    reach = int(LARGEST_SHIFT) + 1
    height, width = values.shape[:2]
    padded = np.pad(values, ((reach, reach), (reach, reach)) + ((0, 0),) * (values.ndim - 2), mode="edge")
    x, y = reach - shift[0], reach - shift[1]
    column, row = int(np.floor(x)), int(np.floor(y))
    across, along = np.float32(x - column), np.float32(y - row)
    rows = padded[row : row + height] * (1 - along) + padded[row + 1 : row + 1 + height] * along
    moved: Float[np.ndarray, "H W *C"]
    moved = rows[:, column : column + width] * (1 - across) + rows[:, column + 1 : column + 1 + width] * across
    return moved
