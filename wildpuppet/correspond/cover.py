"""Which triangle lies under a point, and whether a layer in front hides it. The loops are compiled: ``cover_kernels``.

A layer's mesh reaches beyond its drawing, so being inside a triangle is not enough: a point is *on* a layer, or
*covered* by it, only where the texture's alpha is opaque (at least ``OPAQUE``). Order comes as ``rank``: rank[l] is
layer l's place in the drawing order, higher is nearer. Coordinates are corner origin; shared edges count as inside.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.correspond import cover_kernels
from wildpuppet.correspond.cover_kernels import OPAQUE

__all__ = ["OPAQUE", "barycentrics", "covered", "frontmost", "nearest", "rank_of"]


def rank_of(order: Int[np.ndarray, "T L"]) -> Float[np.ndarray, "T L"]:
    """Turn lists of layers back to front into each layer's place in the order."""
    return np.argsort(order, axis=1).astype(np.float64)


def frontmost(
    vertices: Float[np.ndarray, "V 2"],
    triangles: Int[np.ndarray, "F 3"],
    layer_of_triangle: Int[np.ndarray, "F"],
    rank: Float[np.ndarray, "L"],
    uv: Float[np.ndarray, "V 2"],
    alpha: UInt8[np.ndarray, "H W"],
    points: Float[np.ndarray, "N 2"],
    wanted: Int[np.ndarray, "N"],
) -> Int[np.ndarray, "N"]:
    """Find the triangle under each point, -1 where there is none.

    ``wanted`` -1: the frontmost triangle whose texture is opaque there; else any triangle of that layer.
    """
    found = cover_kernels.frontmost(
        _dense(vertices), _dense_index(triangles), _dense_index(layer_of_triangle), _dense(rank), _dense(uv),
        np.ascontiguousarray(alpha), _dense(points), _dense_index(wanted),
    )  # fmt: skip
    return np.asarray(found)


def covered(
    vertices: Float[np.ndarray, "T V 2"],
    triangles: Int[np.ndarray, "F 3"],
    layer_of_triangle: Int[np.ndarray, "F"],
    rank: Float[np.ndarray, "T L"],
    uv: Float[np.ndarray, "V 2"],
    alpha: UInt8[np.ndarray, "H W"],
    points: Float[np.ndarray, "T N 2"],
    own_layer: Int[np.ndarray, "N"],
) -> Bool[np.ndarray, "T N"]:
    """Say where an opaque texel of a layer in front of ``own_layer`` lies over the point."""
    hidden: Bool[np.ndarray, "T N"] = cover_kernels.covered(
        _dense(vertices), _dense_index(triangles), _dense_index(layer_of_triangle), _dense(rank), _dense(uv),
        np.ascontiguousarray(alpha), _dense(points), _dense_index(own_layer),
    )  # fmt: skip
    return hidden


def nearest(
    vertices: Float[np.ndarray, "V 2"],
    triangles: Int[np.ndarray, "F 3"],
    layer_of_triangle: Int[np.ndarray, "F"],
    points: Float[np.ndarray, "N 2"],
    wanted: Int[np.ndarray, "N"],
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Find the triangle of layer ``wanted`` whose edge is nearest to each point, and how far it is.

    Triangles without area are passed over; -1 and infinity where the layer has no other.
    """
    found, distance = cover_kernels.nearest(
        _dense(vertices), _dense_index(triangles), _dense_index(layer_of_triangle), _dense(points), _dense_index(wanted)
    )
    return found, distance


def barycentrics(
    vertices: Float[np.ndarray, "V 2"], corners: Int[np.ndarray, "N 3"], points: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "N 3"]:
    """Write each point as a mix of three vertices (sums to 1; outside the triangle some are negative)."""
    a, b, c = (vertices[corners[:, k]].astype(np.float64) for k in range(3))
    first, second, offset = b - a, c - a, points - a
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    v = (offset[:, 0] * second[:, 1] - offset[:, 1] * second[:, 0]) / area
    w = (first[:, 0] * offset[:, 1] - first[:, 1] * offset[:, 0]) / area
    return np.stack([1.0 - v - w, v, w], 1)


def _dense(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, np.float64)


def _dense_index(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, np.int64)
