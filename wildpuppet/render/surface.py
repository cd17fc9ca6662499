"""What is seen at each pixel: layer, triangle and barycentrics, without gradient."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int, Int32
from torch import Tensor

from wildpuppet.render.cpu import kernel_arguments, scene_of
from wildpuppet.render.mesh import Mesh
from wildpuppet.render.reference import barycentrics_of, find_fragments, sample
from wildpuppet.render.render import Backend, check_scene, uses_kernels
from wildpuppet.render.surface_kernels import surface_frames
from wildpuppet.render.texture import Texture
from wildpuppet.render.threads import run_shares, shares


class Surface(NamedTuple):
    """The visible layer and triangle of each pixel (-1: none) and the barycentrics (0 where none) of its centre."""

    layer: Int32[Tensor, "B H W"]
    triangle: Int32[Tensor, "B H W"]
    barycentrics: Float[Tensor, "B H W 3"]


def surface(
    vertices: Float[Tensor, "B V 2"],
    mesh: Mesh,
    texture: Texture,
    order: Int[Tensor, "B L"],
    size: tuple[int, int],
    opacity: Float[Tensor, "B L"] | None = None,
    threshold: float = 0.5,
    backend: Backend = "auto",
) -> Surface:
    """Find the visible layer: walking from the front, the one whose alpha takes the coverage to ``threshold``.

    ``threshold`` lies in (0, 1): higher sees through thin mattes to what lies behind, lower takes faint edges for the
    surface. The arguments and errors are those of ``render``; nothing is differentiable.
    """
    check_scene(vertices, mesh, texture, order, size, opacity)
    if not 0.0 < threshold < 1.0:
        raise ValueError(f"threshold must lie between 0 and 1, not {threshold}")
    if opacity is None:
        opacity = vertices.new_ones(order.shape)
    opacity, texture = opacity.to(vertices), Texture(texture.rgba.to(vertices), texture.uv.to(vertices))
    if uses_kernels(vertices, backend):
        return _surface_cpu(vertices, mesh, texture, order, size, opacity, threshold)
    return _surface_reference(vertices, mesh, texture, order, size, opacity, threshold)


def _empty(vertices: Tensor, num_pixels: int) -> Surface:
    """Make a surface on which nothing is seen, flat over pixels."""
    nothing = torch.full((num_pixels,), -1, dtype=torch.int32, device=vertices.device)
    return Surface(nothing, nothing.clone(), vertices.new_zeros(num_pixels, 3))


def _shaped(flat: Surface, batch: int, size: tuple[int, int]) -> Surface:
    """Give pixels their frames, rows and columns."""
    shape = (batch, size[1], size[0])
    return Surface(flat.layer.reshape(shape), flat.triangle.reshape(shape), flat.barycentrics.reshape(*shape, 3))


def _surface_cpu(
    vertices: Tensor,
    mesh: Mesh,
    texture: Texture,
    order: Tensor,
    size: tuple[int, int],
    opacity: Tensor,
    threshold: float,
) -> Surface:
    """Walk the kernels' traversal."""
    batch, num_pixels = len(vertices), size[0] * size[1]
    scene = scene_of(mesh, texture.uv, order, size)
    arguments = kernel_arguments(vertices, texture.rgba, opacity, scene)
    flat = _empty(vertices, batch * num_pixels)
    layers, seen = flat.layer.numpy().reshape(batch, num_pixels), flat.triangle.numpy().reshape(batch, num_pixels)
    weights = flat.barycentrics.numpy().reshape(batch, num_pixels, 3)
    limit = np.float32(threshold)
    run_shares(
        lambda _, first, end: surface_frames(first, end, *arguments, limit, layers, seen, weights), shares(batch)
    )
    original = torch.from_numpy(scene.original.astype(np.int32))
    is_seen = flat.triangle >= 0
    flat.triangle[is_seen] = original[flat.triangle[is_seen].long()]
    return _shaped(flat, batch, size)


@torch.no_grad()
def _surface_reference(
    vertices: Tensor,
    mesh: Mesh,
    texture: Texture,
    order: Tensor,
    size: tuple[int, int],
    opacity: Tensor,
    threshold: float,
) -> Surface:
    """Cover pixels layer by layer from the list of fragments."""
    order, mesh = order.to(vertices.device), mesh.to(vertices.device)
    found = find_fragments(vertices, mesh, order, size)
    weights = barycentrics_of(vertices, mesh, found)
    layer = order[found.frame, found.rank]
    points = (weights[:, :, None] * texture.uv[mesh.triangles[found.triangle]]).sum(1)
    alpha = sample(texture.rgba, points)[:, 3] * opacity[found.frame, layer]
    pixel = (found.frame * size[1] + found.row) * size[0] + found.column
    flat = _empty(vertices, len(vertices) * size[0] * size[1])
    covered = vertices.new_zeros(len(flat.layer))
    for rank in range(order.shape[1] - 1, -1, -1):
        chosen = ((found.rank == rank) & (covered[pixel] < threshold)).nonzero()[:, 0]
        where = pixel[chosen]
        covered[where] += (1.0 - covered[where]) * alpha[chosen]
        chosen = chosen[covered[where] >= threshold]
        where = pixel[chosen]
        flat.layer[where], flat.triangle[where] = layer[chosen].int(), found.triangle[chosen].int()
        flat.barycentrics[where] = weights[chosen]
    return _shaped(flat, len(vertices), size)
