"""Where a point of one frame sits on the puppet: three vertices and their mix.

A point belongs to the part it is named with, else to the frontmost part whose texture is opaque under it, else to the
part whose drawing is nearest (a mesh's transparent margin belongs to what is behind it). A point beside its part's
mesh is written with the nearest triangle's barycentrics, continued beyond its edge, so it keeps its offset.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from wildpuppet.correspond import cover
from wildpuppet.errors import InputError
from wildpuppet.types import Puppet


@dataclass(frozen=True, eq=False)
class Anchors:
    """Where N points sit on a puppet.

    Point n is the mix ``weights[n]`` of the vertices ``corners[n]``, all of layer ``layer[n]``. ``outside[n]`` is its
    distance from the layer's mesh where it was located, 0 inside. Points that are not finite have NaN weights.
    """

    corners: Int[np.ndarray, "N 3"]
    weights: Float[np.ndarray, "N 3"]
    layer: Int[np.ndarray, "N"]
    outside: Float[np.ndarray, "N"]

    def mix(self, values: Float[np.ndarray, "T V 2"]) -> Float[np.ndarray, "T N 2"]:
        """Carry the points to other positions of the vertices."""
        corners = values[:, self.corners].astype(np.float64)
        mixed: Float[np.ndarray, "T N 2"] = np.einsum("tnkd,nk->tnd", corners, self.weights)
        return mixed


def locate(
    puppet: Puppet,
    vertices: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
    points: Float[np.ndarray, "N 2"],
    parts: Sequence[str | None] | None = None,
) -> Anchors:
    """Locate points on the puppet posed at ``vertices``, in the same coordinates.

    Raises InputError for a part the puppet does not have. The usual mistake: canvas points with posed vertices.
    """
    wanted = wanted_layers(puppet, parts, len(points))
    layers, rank = puppet.layer_of_triangle, cover.rank_of(order[None])[0]
    alpha = np.ascontiguousarray(puppet.atlas[..., 3])
    triangle = cover.frontmost(vertices, puppet.triangles, layers, rank, puppet.uv, alpha, points, wanted)
    nowhere = (triangle < 0) & (wanted < 0)
    if nowhere.any():
        wanted[nowhere] = _nearest_drawing(puppet, vertices, points[nowhere])
        triangle[nowhere] = cover.frontmost(
            vertices, puppet.triangles, layers, rank, puppet.uv, alpha, points[nowhere], wanted[nowhere]
        )
    outside = np.zeros(len(points))
    beside = triangle < 0
    triangle[beside], outside[beside] = cover.nearest(
        vertices, puppet.triangles, layers, points[beside], wanted[beside]
    )
    corners = puppet.triangles[triangle].astype(np.int64)
    weights = cover.barycentrics(vertices, corners, points)
    return Anchors(corners, weights, layers[triangle].astype(np.int64), outside)


def wanted_layers(puppet: Puppet, parts: Sequence[str | None] | None, num_points: int) -> Int[np.ndarray, "N"]:
    """Turn part names into layer numbers; -1 where a point names none."""
    if parts is None:
        return np.full(num_points, -1, np.int64)
    if len(parts) != num_points:
        raise ValueError(f"expected one part per point, found {len(parts)} parts for {num_points} points")
    number = {name: layer for layer, name in enumerate(puppet.names)}
    for row, name in enumerate(parts):
        if name is not None and name not in number:
            known = ", ".join(puppet.names)
            raise InputError(f"point {row + 1}: expected one of the puppet's parts ({known}), found {name!r}")
    return np.array([-1 if name is None else number[name] for name in parts], np.int64)


def _nearest_drawing(
    puppet: Puppet, vertices: Float[np.ndarray, "V 2"], points: Float[np.ndarray, "N 2"]
) -> Int[np.ndarray, "N"]:
    """Layer whose opaque texels come nearest to each point."""
    triangle, weights = _rim(puppet)
    if not len(triangle):  # nothing is drawn: the meshes themselves decide
        layers, spots = puppet.layer_of_vertex, vertices
    else:
        layers = puppet.layer_of_triangle[triangle]
        spots = np.einsum("nkd,nk->nd", vertices[puppet.triangles[triangle]].astype(np.float64), weights)
    finite = np.isfinite(points).all(1)
    nearest = np.zeros(len(points), np.int64)
    nearest[finite] = layers[cKDTree(spots).query(points[finite])[1]]
    return nearest


def _rim(puppet: Puppet) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Triangle and barycentrics of every opaque texel that touches a transparent one."""
    opaque = np.pad(puppet.atlas[..., 3] > cover.OPAQUE, 1)
    inner = opaque[1:-1, 1:-1] & opaque[:-2, 1:-1] & opaque[2:, 1:-1] & opaque[1:-1, :-2] & opaque[1:-1, 2:]
    rows, columns = np.nonzero(opaque[1:-1, 1:-1] & ~inner)
    texels = np.stack([columns, rows], 1) + 0.5
    solid = np.full(puppet.atlas.shape[:2], 255, np.uint8)
    any_layer = np.full(len(texels), -1, np.int64)
    triangle = cover.frontmost(
        puppet.uv, puppet.triangles, puppet.layer_of_triangle, np.arange(puppet.num_layers, dtype=np.float64),
        puppet.uv, solid, texels, any_layer,
    )  # fmt: skip
    texels, triangle = texels[triangle >= 0], triangle[triangle >= 0]
    return triangle, cover.barycentrics(puppet.uv, puppet.triangles[triangle], texels)
