# mypy: disable-error-code="no-untyped-def"
"""Numba kernels of ``cover``: triangles under points, and layers over them. See there for the arguments."""

import math

import numpy as np

from wildpuppet.render.jit import exact_kernel

OPAQUE = 127.5
"""Alpha (0..255) from which a texel hides what is behind it."""

INSIDE = -1.0e-9
"""Barycentric coordinates down to this count as inside, so that shared edges leave no gap."""


@exact_kernel
def barycentrics(vertices, triangle, x, y):
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


@exact_kernel
def alpha_at(alpha, x, y):
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


@exact_kernel
def alpha_in(vertices, triangle, uv, alpha, x, y):
    """Alpha of the triangle's texture at (x, y), or -1 outside the triangle."""
    a, b, c = barycentrics(vertices, triangle, x, y)
    if not (a >= INSIDE and b >= INSIDE and c >= INSIDE):
        return -1.0
    u = a * uv[triangle[0], 0] + b * uv[triangle[1], 0] + c * uv[triangle[2], 0]
    v = a * uv[triangle[0], 1] + b * uv[triangle[1], 1] + c * uv[triangle[2], 1]
    return alpha_at(alpha, u, v)


@exact_kernel
def bounds(vertices, triangles):
    """Box of each triangle: left, top, right, bottom."""
    boxes = np.empty((triangles.shape[0], 4))
    for f in range(triangles.shape[0]):
        i, j, k = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        for axis in range(2):
            first, second, third = vertices[i, axis], vertices[j, axis], vertices[k, axis]
            boxes[f, axis] = min(first, second, third) - 1e-6
            boxes[f, 2 + axis] = max(first, second, third) + 1e-6
    return boxes


@exact_kernel
def frontmost(vertices, triangles, layers, rank, uv, alpha, points, wanted):
    """Index of each point's triangle: the frontmost opaque one, or the wanted layer's; -1 for none."""
    boxes = bounds(vertices, triangles)
    found = np.full(points.shape[0], -1, np.int64)
    for n in range(points.shape[0]):
        x, y, best = points[n, 0], points[n, 1], -1.0
        for f in range(triangles.shape[0]):
            if wanted[n] >= 0 and layers[f] != wanted[n]:
                continue
            if x < boxes[f, 0] or y < boxes[f, 1] or x > boxes[f, 2] or y > boxes[f, 3]:
                continue
            texel = alpha_in(vertices, triangles[f], uv, alpha, x, y)
            # A named part takes any of its triangles, the most opaque one where it folds over itself.
            value = texel if wanted[n] >= 0 else (rank[layers[f]] if texel >= OPAQUE else -1.0)
            if value > best:
                best, found[n] = value, f
    return found


@exact_kernel
def covered(vertices, triangles, layers, rank, uv, alpha, points, own):
    """Whether an opaque texel of a layer in front of a point's own lies over it."""
    hidden = np.zeros(points.shape[:2], np.bool_)
    for t in range(points.shape[0]):
        boxes = bounds(vertices[t], triangles)
        for n in range(points.shape[1]):
            x, y = points[t, n, 0], points[t, n, 1]
            for f in range(triangles.shape[0]):
                if x < boxes[f, 0] or y < boxes[f, 1] or x > boxes[f, 2] or y > boxes[f, 3]:
                    continue
                if rank[t, layers[f]] <= rank[t, own[n]]:
                    continue
                if alpha_in(vertices[t], triangles[f], uv, alpha, x, y) >= OPAQUE:
                    hidden[t, n] = True
                    break
    return hidden


@exact_kernel
def segment_distance(x, y, ax, ay, bx, by):
    """Distance from (x, y) to the segment from a to b."""
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    along = 0.0 if length == 0.0 else min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length))
    return math.hypot(ax + along * dx - x, ay + along * dy - y)


@exact_kernel
def nearest(vertices, triangles, layers, points, wanted):
    """The wanted layer's triangle whose edge is nearest to each point, and how far it is."""
    found = np.full(points.shape[0], -1, np.int64)
    distance = np.full(points.shape[0], np.inf)
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        for f in range(triangles.shape[0]):
            if layers[f] != wanted[n]:
                continue
            if math.isnan(barycentrics(vertices, triangles[f], x, y)[0]):
                continue
            for k in range(3):
                i, j = triangles[f, k], triangles[f, (k + 1) % 3]
                away = segment_distance(x, y, vertices[i, 0], vertices[i, 1], vertices[j, 0], vertices[j, 1])
                if away < distance[n]:
                    distance[n], found[n] = away, f
    return found, distance
