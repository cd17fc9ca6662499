"""What is to be seen, frame by frame, and how it is drawn: at ``FINE`` times the size, part by part, back to front."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from tests.figure import FINE
from tests.scenes.background import Background
from tests.scenes.maps import after, mapped, opencv
from tests.scenes.scene import Scene
from wildpuppet.types import CutOut

Art = Mapping[str, np.ndarray]
"""Premultiplied float RGBA (0..255) of every part at ``FINE`` times the canvas."""


@dataclass(frozen=True, eq=False)
class Film:
    """A figure's parts over time: ``world`` (T, L, 2, 3) world_from_canvas, ``camera`` (T, 2, 3) video_from_world.

    ``order`` (T, L) back to front; ``drawing`` and ``shot`` (T,) number distinct drawings and shots. ``art`` gives the
    parts' art for a frame. ``double`` (T, L, 2, 3): a second figure behind the first, no part of the truth.
    ``smears``: for a frame and a part, the places (n, 2, 3) at which it is drawn at once instead of at its own.
    ``light`` (T, 2, 3): what the colours of the world and of the figure are multiplied by. ``ground``: the only
    colours of the world.
    """

    size: tuple[int, int]
    world: np.ndarray
    camera: np.ndarray
    order: np.ndarray
    drawing: np.ndarray
    shot: np.ndarray
    cutout: CutOut
    art: Callable[[int], Art]
    seed: int
    double: np.ndarray | None = None
    smears: Mapping[tuple[int, str], np.ndarray] = field(default_factory=dict)
    light: np.ndarray | None = None
    ground: np.ndarray | None = None

    def draw(self) -> Scene:
        """Draw every frame; the truth comes along."""
        num_shots = self.shot.max() + 1
        grounds = [
            Background(self.camera[self.shot == shot], self.size, [self.seed, shot, 7], self.ground)
            for shot in range(num_shots)
        ]
        pictures = [self._picture(t, grounds[self.shot[t]]) for t in range(len(self.world))]
        alpha = np.stack([picture[..., 3] for picture in pictures])
        boxes = np.stack([np.array(cv2.boundingRect((a > 128).astype(np.uint8)), dtype=float) for a in alpha])
        starts = tuple(int(np.flatnonzero(self.shot == shot)[0]) for shot in range(num_shots))
        shown = np.stack([picture[..., :3] for picture in pictures])
        numbers = np.unique(np.stack([self.drawing, self.shot]), axis=1, return_inverse=True)[1].reshape(-1)
        video_from_canvas = after(self.camera[:, None], self.world)
        return Scene(shown, video_from_canvas, boxes, self.order, self.cutout, alpha, numbers, starts)

    def _picture(self, t: int, background: Background) -> np.ndarray:
        """RGB and coverage of one frame."""
        ground, art = background.through(self.camera[t]), self.art(t)
        if self.light is not None:
            ground = ground * self.light[t, 0].astype(np.float32)
            dye = np.append(self.light[t, 1], 1.0).astype(np.float32)
            art = {name: paint * dye for name, paint in art.items()}
        height, width = ground.shape[:2]
        shown = np.concatenate([ground, np.zeros((height, width, 1), np.float32)], -1)
        names = [part.name for part in self.cutout.parts]
        if self.double is not None:
            for layer in self.order[t]:
                paste(shown, art[names[layer]], after(self.camera[t], self.double[t, layer]), 1.0)
            shown[..., 3] = 0
        for layer in self.order[t]:
            places = self.smears.get((t, names[layer]), self.world[t, layer][None])
            for index, place in enumerate(places):
                strength = 1.0 if index == len(places) - 1 else 0.5
                paste(shown, art[names[layer]], after(self.camera[t], place), strength)
        small = cv2.resize(shown, (width // FINE, height // FINE), interpolation=cv2.INTER_AREA)
        return np.clip(small + 0.5, 0, 255).astype(np.uint8)


def paste(shown: np.ndarray, paint: np.ndarray, video_from_canvas: np.ndarray, strength: float) -> None:
    """Lay a part's art over a picture that is ``FINE`` times the video's size."""
    height, width = shown.shape[:2]
    place = video_from_canvas.copy()
    place[:, 2] *= FINE  # both art and picture are FINE times larger
    x, y, w, h = _bounds(paint)
    corners = mapped(place, np.array([[x, y], [x + w, y], [x, y + h], [x + w, y + h]], dtype=float))
    left, top = np.clip(np.floor(corners.min(0)).astype(int), 0, (width, height))
    right, bottom = np.clip(np.ceil(corners.max(0)).astype(int), 0, (width, height))
    if right <= left or bottom <= top:
        return
    place = after(np.array([[1.0, 0, -left], [0, 1.0, -top]]), after(place, np.array([[1.0, 0, x], [0, 1.0, y]])))
    warped = cv2.warpAffine(paint[y : y + h, x : x + w], opencv(place), (int(right - left), int(bottom - top)))
    warped *= np.float32(strength)
    under = shown[top:bottom, left:right]
    under *= 1 - warped[..., 3:] / 255
    under += warped


def _bounds(paint: np.ndarray) -> tuple[int, int, int, int]:
    x, y, w, h = cv2.boundingRect((paint[..., 3] > 0).astype(np.uint8))
    return x - 1, y - 1, w + 2, h + 2
