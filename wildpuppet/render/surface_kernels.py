# mypy: disable-error-code="no-untyped-def"
# (Numba infers the types of kernels from their arguments.)
"""Numba kernel: which triangle is seen at each pixel. See ``kernels.py`` for the traversal."""

import numpy as np

from wildpuppet.render.jit import kernel
from wildpuppet.render.kernels import (
    B1_DX,
    B1_DY,
    B2_DX,
    B2_DY,
    DU_DX,
    DU_DY,
    DV_DX,
    DV_DY,
    NUM_COLUMNS,
    ONE,
    U_0,
    V_0,
    X_0,
    Y_0,
    ZERO,
    last_texel,
    place_triangles,
    span,
)


@kernel
def alpha_at(texture, texture_size, u, v):
    """Bilinear alpha at texel coordinates (centres on integers)."""
    u = min(max(u, ZERO), last_texel(texture_size[0]))
    v = min(max(v, ZERO), last_texel(texture_size[1]))
    u_texel, v_texel = np.int64(u), np.int64(v)
    fu, fv = u - np.float32(u_texel), v - np.float32(v_texel)
    upper = (v_texel * texture_size[0] + u_texel) * 4 + 3
    lower = upper + texture_size[0] * 4
    above = texture[upper] + fu * (texture[upper + 4] - texture[upper])
    below = texture[lower] + fu * (texture[lower + 4] - texture[lower])
    return above + fv * (below - above)


@kernel
def find_triangle(
    setup, rows, mark, triangle, layer, opacity, texture, texture_size, width, threshold, stamp, covered,
    layers, seen, barycentrics,
):  # fmt: skip
    """Cover one triangle's pixels, and note it where coverage reaches the threshold."""
    for row in range(rows[0], rows[2]):
        begin, end = span(setup, rows[1], row, width)
        y = np.float32(row) - setup[Y_0]
        for column in range(begin, end):
            pixel = row * width + column
            if covered[pixel] >= threshold or stamp[pixel] == mark:
                continue
            stamp[pixel] = mark
            x = np.float32(column) - setup[X_0]
            u = setup[U_0] + x * setup[DU_DX] + y * setup[DU_DY]
            v = setup[V_0] + x * setup[DV_DX] + y * setup[DV_DY]
            alpha = opacity * alpha_at(texture, texture_size, u, v)
            covered[pixel] += (ONE - covered[pixel]) * alpha
            if covered[pixel] >= threshold:
                second, third = x * setup[B1_DX] + y * setup[B1_DY], x * setup[B2_DX] + y * setup[B2_DY]
                layers[pixel], seen[pixel] = layer, triangle
                barycentrics[pixel, 0] = ONE - second - third
                barycentrics[pixel, 1], barycentrics[pixel, 2] = second, third


@kernel
def surface_frames(
    first, end, vertices, triangles, starts, uv, order, opacity, texture, texture_size, size, threshold,
    layers, seen, barycentrics,
):  # fmt: skip
    """Fill layer, triangle (both -1 before) and barycentrics (0 before) of frames first..end; flat per frame."""
    setup = np.empty((len(triangles), NUM_COLUMNS), np.float32)
    rows = np.empty((len(triangles), 3), np.int64)
    stamp = np.empty(size[0] * size[1], np.uint16)
    covered = np.empty(size[0] * size[1], np.float32)
    for frame in range(first, end):
        place_triangles(vertices[frame], triangles, uv, size[1], setup, rows)
        stamp[:] = 0
        covered[:] = ZERO
        for rank in range(order.shape[1] - 1, -1, -1):
            layer = order[frame, rank]
            for triangle in range(starts[layer], starts[layer + 1]):
                find_triangle(
                    setup[triangle], rows[triangle], rank + 1, triangle, layer, opacity[frame, layer],
                    texture, texture_size, size[0], threshold, stamp, covered,
                    layers[frame], seen[frame], barycentrics[frame],
                )  # fmt: skip
