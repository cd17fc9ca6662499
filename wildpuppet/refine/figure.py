"""A puppet ready to be drawn in crops of one size: its picture, and which of its triangles is seen where."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, Int32

from wildpuppet.render.render import mesh_of, render, texture_at
from wildpuppet.render.surface import surface
from wildpuppet.types import Puppet

LEAST_SCALE = 1e-3


class Drawn(NamedTuple):
    """One rendered pose: premultiplied RGBA 0..1, and the layer and triangle seen at each pixel (-1: none)."""

    rgba: Float32[np.ndarray, "H W 4"]
    layer: Int32[np.ndarray, "H W"]
    triangle: Int32[np.ndarray, "H W"]


class Figure:
    """Draws one puppet in pictures of one size; the texture's level suits ``scale``, picture per canvas pixel."""

    def __init__(self, puppet: Puppet, size: tuple[int, int], scale: float) -> None:
        self.puppet, self.size = puppet, size
        self._mesh, self._texture = mesh_of(puppet), texture_at(puppet, max(scale, LEAST_SCALE))

    def draw(
        self, vertices: Float[np.ndarray, "V 2"], order: Int[np.ndarray, "L"], size: tuple[int, int] | None = None
    ) -> Drawn:
        """Draw one pose, picture pixels; ``size`` instead of the usual one."""
        size = size or self.size
        placed = torch.from_numpy(np.array(vertices, np.float32)[None])
        layers = torch.from_numpy(np.array(order, np.int64)[None])
        with torch.no_grad():
            rgba = render(placed, self._mesh, self._texture, layers, size).rgba[0].numpy()
            seen = surface(placed, self._mesh, self._texture, layers, size)
        return Drawn(np.asarray(rgba, np.float32), seen.layer[0].numpy(), seen.triangle[0].numpy())


def scale_of(puppet: Puppet, vertices: Float[np.ndarray, "N V 2"]) -> float:
    """Picture pixels per canvas pixel: the middle over the poses, by the mesh's area."""
    rest = _area(puppet.vertices[None].astype(np.float64), puppet.triangles)[0]
    areas = _area(vertices.astype(np.float64), puppet.triangles)
    return float(np.sqrt(np.median(areas) / max(rest, np.finfo(float).tiny)))


def _area(vertices: Float[np.ndarray, "N V 2"], triangles: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, "N"]:
    a, b, c = (vertices[:, triangles[:, k]] for k in range(3))
    first, second = b - a, c - a
    return np.asarray(np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]).sum(1) / 2.0)
