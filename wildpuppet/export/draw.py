"""Pictures of an animation, one at a time: the whole puppet or one part alone, at the video's size, straight RGBA.

Straight means that colour is not multiplied by alpha. Beyond the edge, where alpha is 0, the nearest colour goes on
for ``BLEED`` pixels: programs that scale or compress the picture mix neighbours, and black there would make a dark rim.
"""

from collections.abc import Iterator

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, Int, UInt8

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.render.render import Mesh, mesh_of, render, texture_at
from wildpuppet.types import Puppet

BLEED = 8
"""Pixels that colour reaches beyond the edge."""
SCALE_FRAMES = 50
"""Frames that decide the typical scale, evenly spread."""


class Painter:
    """Draws an animation. The texture's level suits its typical size on screen."""

    def __init__(self, animation: Animation) -> None:
        self._animation = animation
        self._mesh = mesh_of(animation.puppet)
        self._texture = texture_at(animation.puppet, typical_scale(animation))
        self._layers = [layer_mesh(animation.puppet, layer) for layer in range(animation.puppet.num_layers)]

    def picture(self, frame: Frame, layer: int | None = None) -> UInt8[np.ndarray, "H W 4"]:
        """Draw the whole puppet or one layer, unhidden by others: straight 8-bit RGBA, empty where it is lost."""
        width, height = self._animation.size
        picture = np.zeros((height, width, 4), np.uint8)
        mine = slice(None) if layer is None else self._animation.puppet.layer_of_vertex == layer
        window = window_of(frame.vertices[mine], self._animation.size, BLEED + 1)
        if frame.is_visible and window is not None:
            picture[window] = straight(self._premultiplied(frame, layer, window))
        return picture

    def _premultiplied(
        self, frame: Frame, layer: int | None, window: tuple[slice, slice]
    ) -> Float32[np.ndarray, "h w 4"]:
        rows, columns = window
        with torch.no_grad():
            image = render(
                torch.from_numpy((frame.vertices - (columns.start, rows.start))[None].astype(np.float32)),
                self._mesh if layer is None else self._layers[layer],
                self._texture,
                torch.from_numpy(frame.order[None].astype(np.int64)),
                (columns.stop - columns.start, rows.stop - rows.start),
            )
        return np.asarray(image.rgba[0].numpy(), np.float32)

    def pictures(self, layer: int | None = None) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
        """Draw every frame; one that repeats the frame before is the same array and is not drawn again."""
        before, picture = None, None
        for frame in self._animation:
            if picture is None or before is None or not is_same_picture(before, frame):
                picture = self.picture(frame, layer)
            before = frame
            yield picture


def window_of(vertices: Float[np.ndarray, "n 2"], size: tuple[int, int], border: int) -> tuple[slice, slice] | None:
    """Find the rows and columns of the picture that vertices and a border around them reach; None where none do."""
    if not len(vertices):
        return None
    low = np.clip(np.floor(vertices.min(0)) - border, 0, size).astype(int).tolist()
    high = np.clip(np.ceil(vertices.max(0)) + border, 0, size).astype(int).tolist()
    if high[0] <= low[0] or high[1] <= low[1]:
        return None
    return slice(low[1], high[1]), slice(low[0], high[0])


def is_same_picture(a: Frame, b: Frame) -> bool:
    """Tell whether two frames show exactly the same."""
    if not (a.is_visible and b.is_visible):
        return a.is_visible == b.is_visible
    return bool((a.vertices == b.vertices).all() and (a.order == b.order).all())


def layer_mesh(puppet: Puppet, layer: int) -> Mesh:
    """Take one layer's triangles out of a puppet's mesh."""
    mesh = mesh_of(puppet)
    mine = mesh.layer_of_triangle == layer
    return Mesh(mesh.triangles[mine], mesh.layer_of_triangle[mine], mesh.num_layers)


def straight(premultiplied: Float32[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 4"]:
    """Divide colour by alpha, round to 8 bits, and let colour go on beyond the edge."""
    alpha = premultiplied[..., 3:]
    colour = premultiplied[..., :3] / np.maximum(alpha, 1e-6)
    rgba = np.rint(np.clip(np.concatenate([colour, alpha], -1), 0.0, 1.0) * 255.0).astype(np.uint8)
    return bled(rgba)


def bled(rgba: UInt8[np.ndarray, "H W 4"], reach: int = BLEED) -> UInt8[np.ndarray, "H W 4"]:
    """Give pixels of alpha 0 the colour of the nearest other pixel, up to ``reach`` pixels away, and black beyond."""
    is_empty = rgba[..., 3] == 0
    if is_empty.all() or not is_empty.any():
        return np.where(is_empty[..., None], np.uint8(0), rgba)
    distance, label = cv2.distanceTransformWithLabels(
        is_empty.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    colours = np.zeros((int(label.max()) + 1, 3), np.uint8)
    colours[label[~is_empty]] = rgba[~is_empty, :3]
    filled = rgba.copy()
    filled[is_empty, :3] = np.where((distance <= reach)[is_empty, None], colours[label[is_empty]], 0)
    return filled


def typical_scale(animation: Animation) -> float:
    """Video pixels per canvas pixel: the middle over visible frames, by the mesh's area."""
    visible = np.flatnonzero(animation.is_visible)
    rest = _area(animation.puppet.vertices, animation.puppet.triangles)
    if not len(visible) or rest <= 0.0:
        return 1.0
    chosen = visible[np.linspace(0, len(visible) - 1, min(len(visible), SCALE_FRAMES)).round().astype(int)]
    areas = [_area(animation.vertices(int(t)), animation.puppet.triangles) for t in chosen]
    return max(float(np.sqrt(np.median(areas) / rest)), 1e-3)


def _area(vertices: np.ndarray, triangles: Int[np.ndarray, "F 3"]) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    first, second = b - a, c - a
    return float(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum() / 2.0)
