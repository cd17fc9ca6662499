"""A painted world behind the figure: sky, hills, blobs and a floor of smooth noise."""

import cv2
import numpy as np

from tests.figure import FINE, smooth_noise
from tests.scenes.maps import after, inverse, mapped, opencv


class Background:
    """As large as the camera's path needs.

    ``colours`` (N, 3): paint with these alone, so that a figure of such colours hardly shows.
    """

    def __init__(
        self, video_from_world: np.ndarray, size: tuple[int, int], seed: list[int], colours: np.ndarray | None = None
    ) -> None:
        corners = np.array([[0, 0], [size[0], 0], [0, size[1]], [size[0], size[1]]], dtype=float)
        reach = np.concatenate([mapped(inverse(camera), corners) for camera in video_from_world])
        self.size, self.corner = size, np.floor(reach.min(0)) - 2
        width, height = (np.ceil(reach.max(0)) + 2 - self.corner).astype(int)
        paint = np.random.default_rng(seed)
        if colours is None:
            self.picture = _painting(width, height, size[1] * 0.8 - self.corner[1], paint)
        else:
            self.picture = _patchwork(width, height, colours, paint)

    def through(self, video_from_world: np.ndarray) -> np.ndarray:
        """The view at ``FINE`` times the video's size, float RGB."""
        shifted = after(video_from_world, np.array([[1.0, 0, self.corner[0]], [0, 1.0, self.corner[1]]]))
        width, height = FINE * self.size[0], FINE * self.size[1]
        return cv2.warpAffine(
            self.picture,
            opencv(FINE * shifted),
            (width, height),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )


def _painting(width: int, height: int, floor: float, paint: np.random.Generator) -> np.ndarray:
    def tint(low: int, high: int) -> tuple[int, ...]:
        return tuple(int(c) for c in paint.integers(low, high, 3))

    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = tint(150, 225)
    for _ in range(3):
        centre = (int(paint.uniform(0, width)), int(floor + paint.uniform(10, 60)))
        axes = (int(paint.uniform(0.2, 0.5) * width), int(paint.uniform(0.3, 0.6) * height))
        cv2.ellipse(picture, (centre, (2 * axes[0], 2 * axes[1]), 0.0), tint(95, 190), -1, cv2.LINE_AA)
    for _ in range(max(6, width // 45)):
        x, y = paint.uniform(0, width), paint.uniform(0, floor)
        w, h = paint.uniform(6, 22), paint.uniform(10, 50)
        if paint.random() < 0.5:
            cv2.rectangle(picture, (int(x - w), int(y)), (int(x + w), int(floor)), tint(80, 200), -1)
        else:
            cv2.circle(picture, (int(x), int(y)), int(0.6 * h), tint(90, 220), -1, cv2.LINE_AA)
    cv2.rectangle(picture, (0, int(floor)), (width, height), tint(90, 170), -1)
    texture = sum(share * smooth_noise((height, width), cells, paint) for cells, share in ((5, 22), (17, 12), (71, 9)))
    return _grained(picture + texture[..., None], paint)


def _patchwork(width: int, height: int, colours: np.ndarray, paint: np.random.Generator) -> np.ndarray:
    """Blots of the given colours, about as large as a limb is wide, with soft shading."""
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = colours[0].astype(np.uint8)
    for _ in range(width * height // 900):
        centre = (int(paint.uniform(0, width)), int(paint.uniform(0, height)))
        axes = (int(paint.uniform(6, 30)), int(paint.uniform(6, 30)))
        colour = tuple(int(c) for c in colours[paint.integers(len(colours))])
        cv2.ellipse(picture, centre, axes, float(paint.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
    return _grained(picture + 16 * smooth_noise((height, width), 9, paint)[..., None], paint)


def _grained(picture: np.ndarray, paint: np.random.Generator) -> np.ndarray:
    grain = 1.5 * paint.standard_normal((*picture.shape[:2], 1))
    return np.clip(picture + grain, 0, 255).astype(np.float32)
