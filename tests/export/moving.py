"""Animations whose every vertex and pixel is known: two rectangles that turn, grow and shift, drawn by OpenCV.

Frame 2 holds the drawing of frame 1 while the window moves on, frame 4 is lost, the arm goes behind in frame 5, a new
shot begins in frame 6.
"""

from dataclasses import dataclass, replace
from fractions import Fraction

import cv2
import numpy as np

from tests.correspond import scene
from wildpuppet.export.animation import Animation, animation_of
from wildpuppet.geometry.affine import apply, compose, for_opencv, invert
from wildpuppet.types import Puppet

NUM_FRAMES = 8
HELD, LOST, BEHIND, SHOT = 2, 4, 5, 6
FIRST = 100
FILM = Fraction(24000, 1001)


@dataclass(frozen=True)
class Moving:
    """The animation and the truth behind it: each layer's map from the canvas to the video, (T, L, 2, 3)."""

    animation: Animation
    maps: np.ndarray

    @property
    def puppet(self) -> Puppet:
        return self.animation.puppet

    def vertices(self, t: int) -> np.ndarray:
        layers = self.puppet.layer_of_vertex
        return np.concatenate(
            [apply(self.maps[t, k], self.puppet.vertices[layers == k]) for k in range(self.puppet.num_layers)]
        )

    def layer(self, t: int, layer: int) -> np.ndarray:
        """One part alone as OpenCV draws it: premultiplied RGBA, 0..255."""
        x, y = (self.puppet.vertices - self.puppet.uv)[self.puppet.layer_of_vertex == layer][0]
        atlas = self.puppet.atlas.astype(np.float32)
        atlas[..., :3] *= atlas[..., 3:] / 255.0
        mine = np.zeros_like(atlas)
        uv = self.puppet.uv[self.puppet.layer_of_vertex == layer]
        (left, top), (right, bottom) = uv.min(0).astype(int), uv.max(0).astype(int)
        mine[top:bottom, left:right] = atlas[top:bottom, left:right]
        canvas_from_atlas = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        warp = for_opencv(compose(self.maps[t, layer], canvas_from_atlas))
        return cv2.warpAffine(mine, warp, self.animation.size, flags=cv2.INTER_LINEAR)

    def combined(self, t: int) -> np.ndarray:
        width, height = self.animation.size
        below = np.zeros((height, width, 4), np.float32)
        for layer in self.animation.order[t] if t != LOST else ():
            above = self.layer(t, int(layer))
            below = above + below * (1.0 - above[..., 3:] / 255.0)
        return below


def moving(num_frames: int = NUM_FRAMES, pts: np.ndarray | None = None, **changes: object) -> Moving:
    """Build it; ``pts`` count in 1/24000 s, by default evenly at 24000/1001 frames per second."""
    character = scene.puppet()
    character = replace(
        character,
        joint_layers=np.array([[0, 1]]),
        joint_vertices=np.array([[[0, 1, 2], [25, 26, 27]]]),
        joint_weights=np.array([[[0.2, 0.3, 0.5], [0.5, 0.25, 0.25]]]),
    )
    maps = scene.motion(num_frames)
    crops, fit = scene.posed(character, maps, FIRST)
    if num_frames > HELD:
        window = crops.video_from_crop
        step = compose(window[HELD], invert(window[HELD - 1]))
        maps[HELD] = compose(np.stack([step] * 2), maps[HELD - 1])
        fit.vertices_crop[HELD] = fit.vertices_crop[HELD - 1]
    fit.order[BEHIND:] = [1, 0]
    state = tuple("lost" if t == LOST else "held" if t == HELD else "fitted" for t in range(num_frames))
    times = (np.arange(num_frames) * 1001 if pts is None else pts, Fraction(1, 24000))
    crops = replace(crops, shot=(np.arange(num_frames) >= SHOT).astype(np.int64))
    animation = animation_of(character, crops, replace(fit, state=state), scene.CANVAS, times, "hero run")
    return Moving(replace(animation, **changes), maps)
