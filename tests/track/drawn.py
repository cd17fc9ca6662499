"""Small clips of a textured figure that moves as told over a textured world, with the true box of every frame."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tests.video.clips import encode
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.types import Clip
from wildpuppet.video.probe import probe

SIZE = (320, 200)
FIGURE = (48, 64)
DISC = 30


@dataclass(frozen=True, eq=False)
class Drawn:
    """A clip and its truth: boxes x, y, w, h and the figure's coverage (0..255) per frame."""

    clip: Clip
    boxes: np.ndarray
    alpha: np.ndarray
    pictures: np.ndarray
    worlds: np.ndarray


def painted_world(seed: int, width: int = 960, height: int = 500) -> np.ndarray:
    """Blobs and soft noise in muted colours."""
    paint = np.random.default_rng(seed)
    world = np.full((height, width, 3), paint.integers(90, 170, 3), np.uint8)
    for _ in range(width * height // 2500):
        centre = (int(paint.integers(0, width)), int(paint.integers(0, height)))
        colour = tuple(int(c) for c in paint.integers(60, 200, 3))
        axes = (int(paint.integers(6, 40)), int(paint.integers(6, 30)))
        cv2.ellipse(world, centre, axes, float(paint.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
    noise = cv2.GaussianBlur(paint.normal(0, 40, (height, width, 1)), (0, 0), 2.0)
    return np.clip(cv2.GaussianBlur(world, (0, 0), 1.0) + noise.reshape(height, width, 1), 0, 255).astype(np.uint8)


def painted_figure() -> np.ndarray:
    """A body with a head, stripes and a belt at four times the size: premultiplied RGBA, float."""
    width, height = 4 * FIGURE[0], 4 * FIGURE[1]
    rgba = np.zeros((height, width, 4), np.float32)
    cv2.ellipse(
        rgba, (width // 2, int(0.62 * height)), (width // 2 - 1, int(0.37 * height)), 0, 0, 360, (200, 40, 50, 255), -1
    )
    cv2.circle(rgba, (width // 2, int(0.18 * height)), int(0.17 * height), (240, 200, 160, 255), -1)
    for x in range(width // 8, width, width // 5):
        cv2.line(rgba, (x, int(0.5 * height)), (x, int(0.9 * height)), (250, 230, 60, 255), width // 16)
    cv2.rectangle(rgba, (0, int(0.6 * height)), (width, int(0.68 * height)), (30, 30, 120, 255), -1)
    inside = np.zeros((height, width), np.uint8)
    cv2.ellipse(inside, (width // 2, int(0.62 * height)), (width // 2 - 1, int(0.37 * height)), 0, 0, 360, 255, -1)
    cv2.circle(inside, (width // 2, int(0.18 * height)), int(0.17 * height), 255, -1)
    cv2.circle(rgba, (int(0.4 * width), int(0.16 * height)), height // 40, (20, 20, 20, 255), -1)
    return rgba * (inside[..., None] > 0)


def draw_clip(
    path: Path,
    centres: np.ndarray,
    scales: np.ndarray | None = None,
    camera: np.ndarray | None = None,
    zoom: np.ndarray | None = None,
    seeds: np.ndarray | None = None,
    shown: np.ndarray | None = None,
    discs: np.ndarray | None = None,
) -> Drawn:
    """Draw a figure with its centre at ``centres`` (video pixels) and ``scales`` times its size, and encode it.

    ``camera`` is the world's point at the picture's corner and ``zoom`` the video pixels per world pixel; ``seeds``
    choose the world (a change is a cut); ``shown`` False leaves the figure out; ``discs`` are the centres of a green
    disc that moves behind it.
    """
    count = len(centres)
    scales = np.ones(count) if scales is None else scales
    camera = np.tile([200.0, 120.0], (count, 1)) if camera is None else camera
    zoom = np.ones(count) if zoom is None else zoom
    seeds = np.zeros(count, int) if seeds is None else seeds
    shown = np.ones(count, bool) if shown is None else shown
    worlds = {int(seed): painted_world(int(seed)) for seed in np.unique(seeds)}
    art = painted_figure()
    pictures, alpha, boxes, behind = [], [], [], []
    for t in range(count):
        ground = view(worlds[int(seeds[t])], camera[t], zoom[t])
        if discs is not None:
            cv2.circle(ground, tuple(int(v) for v in discs[t]), DISC, (70.0, 160.0, 60.0), -1, cv2.LINE_AA)
        figure = placed(art, centres[t], scales[t]) if shown[t] else np.zeros((SIZE[1], SIZE[0], 4), np.float32)
        cover = figure[..., 3:] / 255.0
        pictures.append(np.clip(ground * (1 - cover) + figure[..., :3] + 0.5, 0, 255).astype(np.uint8))
        alpha.append(figure[..., 3].astype(np.uint8))
        behind.append(ground.astype(np.uint8))
        half = 0.5 * scales[t] * np.array(FIGURE)
        boxes.append([*(centres[t] - half), *(2 * half)])
    clip = probe(encode(path, pictures, crf="12"), ProbeSettings(), Machine())
    return Drawn(clip, np.array(boxes), np.stack(alpha), np.stack(pictures), np.stack(behind))


def view(world: np.ndarray, corner: np.ndarray, zoom: float) -> np.ndarray:
    """See the world through the camera; OpenCV's pixel centres are half a pixel from ours."""
    scale = 1.0 / zoom
    matrix = np.array([[scale, 0, corner[0] + 0.5 * scale - 0.5], [0, scale, corner[1] + 0.5 * scale - 0.5]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(world, matrix, SIZE, flags=flags, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)


def placed(art: np.ndarray, centre: np.ndarray, scale: float) -> np.ndarray:
    """Put the figure's art, four times too large, where its centre should be."""
    shrink = scale / 4.0
    left, top = centre - 0.5 * scale * np.array(FIGURE)
    matrix = np.array([[shrink, 0, left + 0.5 * shrink - 0.5], [0, shrink, top + 0.5 * shrink - 0.5]])
    soft = cv2.GaussianBlur(art, (0, 0), 0.5 / shrink)
    return cv2.warpAffine(soft, matrix, SIZE)


def overlap(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Intersection over union of boxes, row by row."""
    low = np.maximum(first[:, :2], second[:, :2])
    high = np.minimum(first[:, :2] + first[:, 2:], second[:, :2] + second[:, 2:])
    shared = np.maximum(high - low, 0).prod(1)
    return shared / (first[:, 2:].prod(1) + second[:, 2:].prod(1) - shared)


def line(start: tuple[float, float], end: tuple[float, float], count: int) -> np.ndarray:
    """Points evenly from start to end."""
    return np.linspace(start, end, count)
