"""How far a method's picture is from the drawing: Table 1's number.

The drawing lies over white paper, at its own size; the error is the mean of the squared difference over all pixels and
the three colours, 0..255. That is the paper's "mean L2" in the one reading in which its numbers are possible: 776 is
19.2 dB. White paper around the character counts and makes the number smaller, so the same mean over the character's
own box stands beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from wildpuppet.refine import texture

Picture = UInt8[np.ndarray, "H W 3"]

INK = 8
"""Levels by which a pixel differs from white where the character is."""
PEAK = 255.0


@dataclass(frozen=True)
class PictureError:
    """Mean squared error over the whole drawing, and over the box of what is drawn on it."""

    whole: float
    box: float


def picture_error(drawing: Picture, found: Picture) -> PictureError:
    """Compare a method's picture with the drawing."""
    squares = squared(drawing, found)
    return PictureError(float(squares.mean()), float(squares[ink_box(drawing)].mean()))


def mean_squared_error(drawing: Picture, found: Picture) -> float:
    """Average the squared difference over pixels and colours."""
    return float(squared(drawing, found).mean())


def squared(drawing: Picture, found: Picture) -> Float32[np.ndarray, "H W 3"]:
    """Square the difference, value by value."""
    return np.asarray((drawing.astype(np.float32) - found.astype(np.float32)) ** 2)


def on_white(premultiplied: Float32[np.ndarray, "H W 4"]) -> Picture:
    """Lay a premultiplied picture, 0..1, over white paper."""
    return np.asarray(np.rint(np.clip(texture.on_white(premultiplied), 0.0, 1.0) * PEAK), np.uint8)


def decibels(error: float) -> float:
    """Turn a mean squared error into the peak signal-to-noise ratio; infinite where there is no error."""
    return float("inf") if error <= 0.0 else float(10.0 * np.log10(PEAK**2 / error))


def ink_box(drawing: Picture) -> tuple[slice, slice]:
    """Find the rows and columns of what is drawn on white; the whole picture where nothing is."""
    is_ink = drawing.min(-1) < 255 - INK
    if not is_ink.any():
        return slice(None), slice(None)
    rows, columns = (np.flatnonzero(is_ink.any(axis)) for axis in (1, 0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def picture_errors(drawings: Sequence[Picture], found: Sequence[Picture]) -> PictureError:
    """Average over drawings; raises ValueError where there is not one picture for each."""
    errors = [picture_error(*pair) for pair in zip(drawings, found, strict=True)]
    return PictureError(*(float(np.mean([getattr(error, name) for error in errors])) for name in ("whole", "box")))
