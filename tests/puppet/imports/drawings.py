"""A small figure as layers: random pixels, so that one wrong pixel, offset or channel shows."""

from dataclasses import dataclass

import numpy as np

SIZE = (90, 70)


@dataclass(frozen=True)
class Drawn:
    """A picture with its place on the canvas of ``SIZE``."""

    rgba: np.ndarray
    corner: tuple[int, int]

    def on_canvas(self) -> np.ndarray:
        """Put it on the canvas, pixel by pixel."""
        canvas = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
        for row in range(self.rgba.shape[0]):
            for column in range(self.rgba.shape[1]):
                x, y = column + self.corner[0], row + self.corner[1]
                if 0 <= x < SIZE[0] and 0 <= y < SIZE[1]:
                    canvas[y, x] = self.rgba[row, column]
        return canvas


def random_picture(seed: int, width: int, height: int, alpha: int | None = None) -> np.ndarray:
    """Random colours; random alpha above 0 unless one is given (colour under alpha 0 is nobody's business)."""
    picture = np.random.default_rng(seed).integers(1, 256, (height, width, 4), np.uint8)
    if alpha is not None:
        picture[..., 3] = alpha
    return picture


TORSO = Drawn(random_picture(1, 40, 40), (20, 15))
ARM = Drawn(random_picture(2, 30, 12), (50, 20))
HAND = Drawn(random_picture(3, 20, 14), (75, 19))
"""Reaches five pixels beyond the canvas."""


def assert_same_picture(found: np.ndarray, expected: np.ndarray, tolerance: int = 0) -> None:
    """Compare alpha everywhere, and colour wherever there is any alpha."""
    assert np.abs(found[..., 3].astype(int) - expected[..., 3]).max() <= tolerance
    seen = expected[..., 3] > 0
    assert np.abs(found[seen].astype(int) - expected[seen]).max() <= tolerance
