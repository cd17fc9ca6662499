"""A film whose every pixel is known: the moving puppet of the export tests over a background, drawn by OpenCV."""

from dataclasses import dataclass
from fractions import Fraction

import cv2
import numpy as np
from PIL import Image

from tests.export.moving import Moving, moving
from wildpuppet.export.animation import Animation
from wildpuppet.geometry.affine import for_opencv
from wildpuppet.paint.texture import canvas_pictures, edited

PAINT = (230, 30, 210)
SPOT = (98, 50)
"""Centre on the canvas; on the arm where it lies over the body."""
RADIUS = 6
HIDDEN = (1, 2)
"""Frames in which the body lies over the arm and a piece of the spot."""


def background(size: tuple[int, int]) -> np.ndarray:
    """Soft greens and greys, nothing of the puppet's colours."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    wave = 12 * np.sin(x / 17.0) + 9 * np.cos(y / 11.0)
    return np.clip(np.stack([120 + wave, 150 + wave, 110 - wave], -1), 0, 255).astype(np.uint8)


def over(premultiplied: np.ndarray, below: np.ndarray) -> np.ndarray:
    return premultiplied[..., :3] + (1.0 - premultiplied[..., 3:] / 255.0) * below


@dataclass(frozen=True)
class Film:
    """Frames (T, H, W, 3), the background, and what drew them; a source and a background as painting asks for."""

    scene: Moving
    frames: np.ndarray
    ground: np.ndarray

    @property
    def animation(self) -> Animation:
        return self.scene.animation

    def picture(self, *where: object) -> np.ndarray:
        """A frame by its number (a source), or the background (what lies behind)."""
        if len(where) > 1:
            return self.ground
        number = where[0]
        assert isinstance(number, int)
        return self.frames[number - int(self.animation.frames[0])]

    def times(self, frames: np.ndarray) -> tuple[np.ndarray, Fraction]:
        return frames, Fraction(1, 24)

    def spot(self, t: int) -> np.ndarray:
        """Coverage (0..1) of the painted spot on the arm in frame t, whatever covers it."""
        canvas = np.zeros((self.scene.puppet.canvas[1], self.scene.puppet.canvas[0]), np.float32)
        canvas[spot_mask(canvas.shape)] = 1.0
        return cv2.warpAffine(canvas, for_opencv(self.scene.maps[t, 1]), self.animation.size, flags=cv2.INTER_LINEAR)


def spot_mask(shape: tuple[int, ...]) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return np.asarray((x - SPOT[0]) ** 2 + (y - SPOT[1]) ** 2 < RADIUS**2)


def film(light: np.ndarray | None = None, noise: int = 2) -> Film:
    """Draw it; ``light`` (T,) multiplies the character alone."""
    scene = moving()
    scene.animation.order[list(HIDDEN)] = [1, 0]
    ground = background(scene.animation.size)
    grain = np.random.default_rng(1)
    frames = []
    for t in range(len(scene.animation)):
        figure = scene.combined(t)
        if light is not None:
            figure[..., :3] *= light[t]
        shown = over(figure, ground) + grain.integers(-noise, noise + 1, (*ground.shape[:2], 1))
        frames.append(np.clip(np.rint(shown), 0, 255).astype(np.uint8))
    return Film(scene, np.stack(frames), ground)


def repainted(puppet, name, colour=PAINT, mask=None):
    """Paint a part's opaque pixels, all or those of ``mask``."""
    before = canvas_pictures(puppet)
    picture = before[name].copy()
    chosen = (picture[..., 3] > 0) & (True if mask is None else mask)
    picture[chosen, :3] = colour
    return edited(puppet, before, {name: picture})


def with_spot(puppet):
    return repainted(puppet, "arm", mask=spot_mask((puppet.canvas[1], puppet.canvas[0])))


def written(folder) -> list[np.ndarray]:
    return [np.asarray(Image.open(path)) for path in sorted((folder / "frames").iterdir())]
