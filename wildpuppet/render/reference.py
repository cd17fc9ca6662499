"""The reference renderer in plain torch: any device, any floating type, gradients by autograd.

Every triangle of every frame is scan-converted at once into a list of fragments (the same top-left rule and the same
rounding as ``kernels.py``); layers are then composited front to back. Nothing is truncated: it is the oracle for the
fast path and the path for other devices. Which fragments exist does not depend smoothly on the vertices, so that part
is not differentiated: with a texture whose alpha is 0 along every mesh border the image is continuous all the same and
the gradient is complete.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from wildpuppet.render.kernels import LEAST_AREA
from wildpuppet.render.mesh import Mesh


class Fragments(NamedTuple):
    """Pixels covered by triangles, at most one per frame, layer and pixel. ``rank`` 0 is the backmost layer."""

    frame: Int[Tensor, "N"]
    rank: Int[Tensor, "N"]
    triangle: Int[Tensor, "N"]
    row: Int[Tensor, "N"]
    column: Int[Tensor, "N"]


def _first_centre(coordinate: Tensor, limit: int) -> Tensor:
    """Index of the first pixel whose centre is at or beyond ``coordinate``, within 0..limit."""
    return (coordinate - 0.5).clamp(0, limit).ceil().long()


def _expand(first: Tensor, end: Tensor) -> tuple[Tensor, Tensor]:
    """List (owner, index) for every index in first..end of each owner."""
    counts = (end - first).clamp(min=0)
    owner = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    before = counts.cumsum(0) - counts
    return owner, torch.arange(len(owner), device=counts.device) - before[owner] + first[owner]


def _crossing(upper: Tensor, lower: Tensor, y: Tensor) -> Tensor:
    """Find x where the edge from ``upper`` to ``lower`` meets the row at y, computed from the upper end."""
    slope = (lower[:, 0] - upper[:, 0]) / (lower[:, 1] - upper[:, 1])
    return upper[:, 0] + (y - upper[:, 1]) * slope


@torch.no_grad()
def find_fragments(
    vertices: Float[Tensor, "B V 2"], mesh: Mesh, order: Int[Tensor, "B L"], size: tuple[int, int]
) -> Fragments:
    """Scan-convert every triangle of every frame."""
    width, height = size
    num_triangles = len(mesh.triangles)
    corners = vertices[:, mesh.triangles].flatten(0, 1)
    by_y = corners[:, :, 1].argsort(dim=1, stable=True)
    top, mid, low = corners.gather(1, by_y[:, :, None].expand(-1, -1, 2)).unbind(1)
    owner, row = _expand(_first_centre(top[:, 1], height), _first_centre(low[:, 1], height))
    y = row.to(vertices.dtype) + 0.5
    is_upper = (row < _first_centre(mid[:, 1], height)[owner])[:, None]
    x_long = _crossing(top[owner], low[owner], y)
    x_short = _crossing(torch.where(is_upper, top[owner], mid[owner]), torch.where(is_upper, mid[owner], low[owner]), y)
    begin = _first_centre(torch.minimum(x_long, x_short), width)
    line, column = _expand(begin, _first_centre(torch.maximum(x_long, x_short), width))
    frame, triangle = owner[line] // num_triangles, owner[line] % num_triangles
    rank = order.argsort(dim=1)[frame, mesh.layer_of_triangle[triangle]]
    return _once(Fragments(frame, rank, triangle, row[line], column), order.shape[1], size)


def _once(found: Fragments, num_layers: int, size: tuple[int, int]) -> Fragments:
    """Keep the first fragment of each frame, layer and pixel."""
    key = ((found.frame * num_layers + found.rank) * size[1] + found.row) * size[0] + found.column
    key, place = key.sort(stable=True)
    is_first = torch.ones_like(key, dtype=torch.bool)
    is_first[1:] = key[1:] != key[:-1]
    keep = place[is_first]
    return Fragments(*(column[keep] for column in found))


def barycentrics_of(vertices: Float[Tensor, "B V 2"], mesh: Mesh, found: Fragments) -> Float[Tensor, "N 3"]:
    """Barycentrics of the fragments' centres; (1, 0, 0) in a triangle without area."""
    corners = vertices[found.frame[:, None], mesh.triangles[found.triangle]]
    first, edges = corners[:, 0], corners[:, 1:] - corners[:, :1]
    (x1, y1), (x2, y2) = edges[:, 0].unbind(1), edges[:, 1].unbind(1)
    area = x1 * y2 - x2 * y1
    is_flat = area.abs() <= float(LEAST_AREA)
    inverse = torch.where(is_flat, 0.0, 1.0 / torch.where(is_flat, 1.0, area))
    centre = torch.stack([found.column, found.row], 1).to(vertices.dtype) + 0.5
    x, y = (centre - first).unbind(1)
    second, third = (x * y2 - y * x2) * inverse, (y * x1 - x * y1) * inverse
    return torch.stack([1.0 - second - third, second, third], 1)


def sample(rgba: Float[Tensor, "H W 4"], points: Float[Tensor, "N 2"]) -> Float[Tensor, "N 4"]:
    """Bilinear samples at texture pixels (corner origin), clamped at the border."""
    height, width = rgba.shape[:2]
    u, v = (points[:, 0] - 0.5).clamp(0, width - 1), (points[:, 1] - 0.5).clamp(0, height - 1)
    column, row = u.detach().long().clamp(max=width - 2), v.detach().long().clamp(max=height - 2)
    fu, fv = (u - column)[:, None], (v - row)[:, None]
    upper = rgba[row, column] * (1 - fu) + rgba[row, column + 1] * fu
    lower = rgba[row + 1, column] * (1 - fu) + rgba[row + 1, column + 1] * fu
    return upper * (1 - fv) + lower * fv


def composite_reference(
    vertices: Float[Tensor, "B V 2"],
    mesh: Mesh,
    rgba: Float[Tensor, "H W 4"],
    uv: Float[Tensor, "V 2"],
    order: Int[Tensor, "B L"],
    size: tuple[int, int],
    opacity: Float[Tensor, "B L"],
) -> Float[Tensor, "B h w 4"]:
    """Render a batch; every argument on one device, every float of one type."""
    width, height = size
    found = find_fragments(vertices, mesh, order, size)
    weights = barycentrics_of(vertices, mesh, found)
    points = (weights[:, :, None] * uv[mesh.triangles[found.triangle]]).sum(1)
    colour = sample(rgba, points) * opacity[found.frame, order[found.frame, found.rank]][:, None]
    pixel = (found.frame * height + found.row) * width + found.column
    image = vertices.new_zeros(len(vertices) * height * width, 4)
    transmittance = vertices.new_ones(len(image))
    for rank in range(order.shape[1] - 1, -1, -1):
        chosen = (found.rank == rank).nonzero()[:, 0]
        where, front = pixel[chosen], transmittance[pixel[chosen]]
        image = image.index_add(0, where, front[:, None] * colour[chosen])
        transmittance = transmittance.index_put((where,), front * (1.0 - colour[chosen, 3]))
    return image.reshape(len(vertices), height, width, 4)
