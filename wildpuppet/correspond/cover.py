"""Which triangle lies under a point, and whether a layer in front hides it: small compiled loops.

A layer's mesh reaches beyond its drawing, so being inside a triangle is not enough: a point is *on* a layer, or
*covered* by it, only where the texture's alpha is opaque (at least ``OPAQUE``). Order comes as ``rank``: rank[l] is
layer l's place in the drawing order, higher is nearer. Coordinates are corner origin; shared edges count as inside.
"""

import math

import numba
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

OPAQUE = 127.5
"""Alpha (0..255) from which a texel hides what is behind it."""

INSIDE = -1.0e-9
"""Barycentric coordinates down to this count as inside, so that shared edges leave no gap."""


@numba.njit(cache=True)
def _barycentrics(vertices, triangle, x, y):  # type: ignore[no-untyped-def]
    """Mix of the triangle's corners that gives (x, y); NaN for a triangle without area."""
    ax, ay = vertices[triangle[0], 0], vertices[triangle[0], 1]
    bx, by = vertices[triangle[1], 0] - ax, vertices[triangle[1], 1] - ay
    cx, cy = vertices[triangle[2], 0] - ax, vertices[triangle[2], 1] - ay
    area = bx * cy - by * cx
    if area == 0.0:
        return np.nan, np.nan, np.nan
    second = ((x - ax) * cy - (y - ay) * cx) / area
    third = (bx * (y - ay) - by * (x - ax)) / area
    return 1.0 - second - third, second, third


@numba.njit(cache=True)
def _alpha_at(alpha, x, y):  # type: ignore[no-untyped-def]
    """Bilinear alpha at an atlas position, 0 beyond the atlas."""
    height, width = alpha.shape
    left, top = math.floor(x - 0.5), math.floor(y - 0.5)
    right_share, low_share = x - 0.5 - left, y - 0.5 - top
    total = 0.0
    for row in range(2):
        for column in range(2):
            v, u = top + row, left + column
            if 0 <= v < height and 0 <= u < width:
                share = (low_share if row else 1.0 - low_share) * (right_share if column else 1.0 - right_share)
                total += share * alpha[v, u]
    return total


@numba.njit(cache=True)
def _alpha_in(vertices, triangle, uv, alpha, x, y):  # type: ignore[no-untyped-def]
    """Alpha of the triangle's texture at (x, y), or -1 outside the triangle."""
    a, b, c = _barycentrics(vertices, triangle, x, y)
    if not (a >= INSIDE and b >= INSIDE and c >= INSIDE):
        return -1.0
    u = a * uv[triangle[0], 0] + b * uv[triangle[1], 0] + c * uv[triangle[2], 0]
    v = a * uv[triangle[0], 1] + b * uv[triangle[1], 1] + c * uv[triangle[2], 1]
    return _alpha_at(alpha, u, v)


@numba.njit(cache=True)
def _bounds(vertices, triangles):  # type: ignore[no-untyped-def]
    """Box of each triangle: left, top, right, bottom."""
    boxes = np.empty((triangles.shape[0], 4))
    for f in range(triangles.shape[0]):
        i, j, k = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        for axis in range(2):
            first, second, third = vertices[i, axis], vertices[j, axis], vertices[k, axis]
            boxes[f, axis] = min(first, second, third) - 1e-6
            boxes[f, 2 + axis] = max(first, second, third) + 1e-6
    return boxes


@numba.njit(cache=True)
def _frontmost(vertices, triangles, layers, rank, uv, alpha, points, wanted):  # type: ignore[no-untyped-def]
    boxes = _bounds(vertices, triangles)
    found = np.full(points.shape[0], -1, np.int64)
    for n in range(points.shape[0]):
        x, y, best = points[n, 0], points[n, 1], -1.0
        for f in range(triangles.shape[0]):
            if wanted[n] >= 0 and layers[f] != wanted[n]:
                continue
            if x < boxes[f, 0] or y < boxes[f, 1] or x > boxes[f, 2] or y > boxes[f, 3]:
                continue
            texel = _alpha_in(vertices, triangles[f], uv, alpha, x, y)
            # A named part takes any of its triangles, the most opaque one where it folds over itself.
            value = texel if wanted[n] >= 0 else (rank[layers[f]] if texel >= OPAQUE else -1.0)
            if value > best:
                best, found[n] = value, f
    return found


@numba.njit(cache=True)
def _covered(vertices, triangles, layers, rank, uv, alpha, points, own):  # type: ignore[no-untyped-def]
    hidden = np.zeros(points.shape[:2], np.bool_)
    for t in range(points.shape[0]):
        boxes = _bounds(vertices[t], triangles)
        for n in range(points.shape[1]):
            x, y = points[t, n, 0], points[t, n, 1]
            for f in range(triangles.shape[0]):
                if x < boxes[f, 0] or y < boxes[f, 1] or x > boxes[f, 2] or y > boxes[f, 3]:
                    continue
                if rank[t, layers[f]] <= rank[t, own[n]]:
                    continue
                if _alpha_in(vertices[t], triangles[f], uv, alpha, x, y) >= OPAQUE:
                    hidden[t, n] = True
                    break
    return hidden


@numba.njit(cache=True)
def _segment_distance(x, y, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    along = 0.0 if length == 0.0 else min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length))
    return math.hypot(ax + along * dx - x, ay + along * dy - y)


@numba.njit(cache=True)
def _nearest(vertices, triangles, layers, points, wanted):  # type: ignore[no-untyped-def]
    found = np.full(points.shape[0], -1, np.int64)
    distance = np.full(points.shape[0], np.inf)
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        for f in range(triangles.shape[0]):
            if layers[f] != wanted[n]:
                continue
            if math.isnan(_barycentrics(vertices, triangles[f], x, y)[0]):
                continue
            for k in range(3):
                i, j = triangles[f, k], triangles[f, (k + 1) % 3]
                away = _segment_distance(x, y, vertices[i, 0], vertices[i, 1], vertices[j, 0], vertices[j, 1])
                if away < distance[n]:
                    distance[n], found[n] = away, f
    return found, distance


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
    found = _frontmost(
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
    hidden: Bool[np.ndarray, "T N"] = _covered(
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
    found, distance = _nearest(
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
