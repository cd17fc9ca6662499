"""Scenes that many tests use: the ten-part figure walks, crosses its arms, hides one, reorders its layers.

Kinds: walk (legs and arms cross), crossing (both arms sweep over the body), hidden (the left arm goes fully behind
the torso), order (the right arm goes from the front to the back of the torso), pan and zoom (a moving camera), cut
(a second shot on another background), twos (each drawing is held for two frames). ``hold``, ``camera`` and
``cut_at`` combine with any kind.
"""

import numpy as np

from tests.figure import draw_figure
from tests.scenes.film import Film
from tests.scenes.maps import about, after
from tests.scenes.motion import FIGURE_HEIGHT, Camera, Kind, camera_at, layers, posed
from tests.scenes.scene import Scene


def make_scene(
    kind: Kind = "walk",
    frames: int = 24,
    size: tuple[int, int] = (320, 240),
    seed: int = 0,
    *,
    hold: int | None = None,
    camera: Camera | None = None,
    cut_at: int | None = None,
    identical: bool = False,
    height: float = 0.68,
    cycles: float = 1.25,
) -> Scene:
    """Draw a scene. ``height`` is the figure's share of the picture's; ``identical`` paints left and right limbs alike.

    ``cycles`` counts strides over the clip (a stride is two steps). A held figure still lets the camera move.
    """
    hold = hold or (2 if kind == "twos" else 1)
    camera = camera or ({"pan": "pan", "zoom": "zoom"}.get(kind, "still"))
    cut_at = cut_at or (frames // 2 if kind == "cut" else None)
    drawing = np.arange(frames) // hold * hold
    shares = drawing / max(frames - 1, 1)
    shot = np.zeros(frames, int) if cut_at is None else (np.arange(frames) >= cut_at).astype(int)
    scale = height * size[1] / FIGURE_HEIGHT
    world = np.stack([posed(kind, share, size, scale, camera, cycles) for share in shares])
    world[shot == 1] = after(about((size[0] / 2, size[1] * 0.95), 0.8, 0.0), world[shot == 1])
    path = np.stack([camera_at(camera, time, size) for time in np.arange(frames) / max(frames - 1, 1)])
    order = np.stack([layers(kind, share) for share in shares])
    figure = draw_figure(seed, identical)
    cutout = figure.cutout
    return Film(size, world, path, order, drawing, shot, cutout, lambda t: figure.art, seed).draw()
