# mypy: disable-error-code="no-untyped-def"
# (Numba infers the types of kernels from their arguments.)
"""Numba kernels: composite layers front to back into one frame, and walk the same pixels again for the gradient.

Traversal. Triangles are scan-converted into spans without a depth buffer. A pixel belongs to a triangle when its
centre lies in [left crossing, right crossing) of a row in [top, bottom): the top-left rule, with each crossing computed
from the edge's upper end alone, so that two triangles agree on the edge they share to the last bit. ``stamp`` keeps
the last layer (rank + 1) that claimed a pixel: a layer covers a pixel once even where its mesh folds.

Composite. With T the transmittance in front, o the layer's opacity and c = (r, g, b, a) the premultiplied texture:
R += T o c, T *= 1 - o a. Walking stops for a pixel when T < STOP.

Gradient. With G = dL/dR, the only thing that a fragment must know of what lies behind it is the dot product
D = G . (R_final - R_so_far), one number per pixel; dL/da through occlusion is -o D / (1 - o a). Each vertex i of a
triangle then gets -b_i J^T dL/duv, b the barycentrics and J = duv/dxy, from six sums per triangle.

Arrays are flat and indices unsigned (Numba adds no wrap-around tests then); every scalar is float32 by name, since one
float64 literal would make the whole expression double.
"""

import math

import numpy as np

from wildpuppet.render.jit import exact_kernel, kernel

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
STOP = np.float32(1.0 / 1024.0)
LEAST_AREA = np.float32(1e-5)
"""Twice the area in square pixels under which a triangle's texture stands still (its gradient would be noise)."""

NUM_COLUMNS = 19
X_TOP, Y_TOP, X_MID, Y_MID, SLOPE_LONG, SLOPE_UPPER, SLOPE_LOWER = range(7)
X_0, Y_0, U_0, V_0, DU_DX, DU_DY, DV_DX, DV_DY, B1_DX, B1_DY, B2_DX, B2_DY = range(7, 19)


@exact_kernel
def first_centre(coordinate, limit):
    """Index of the first pixel whose centre is at or beyond ``coordinate``, within 0..limit."""
    return np.int64(math.ceil(min(max(coordinate - HALF, ZERO), np.float32(limit))))


@exact_kernel
def place_edges(corners, setup, rows, height):
    """Sort a triangle's corners by y; write the upper ends, slopes and rows of its three edges."""
    top, mid, low = 0, 1, 2
    if corners[mid, 1] < corners[top, 1]:
        top, mid = mid, top
    if corners[low, 1] < corners[mid, 1]:
        mid, low = low, mid
    if corners[mid, 1] < corners[top, 1]:
        top, mid = mid, top
    setup[X_TOP], setup[Y_TOP] = corners[top, 0], corners[top, 1]
    setup[X_MID], setup[Y_MID] = corners[mid, 0], corners[mid, 1]
    setup[SLOPE_LONG] = (corners[low, 0] - corners[top, 0]) / (corners[low, 1] - corners[top, 1])
    setup[SLOPE_UPPER] = (corners[mid, 0] - corners[top, 0]) / (corners[mid, 1] - corners[top, 1])
    setup[SLOPE_LOWER] = (corners[low, 0] - corners[mid, 0]) / (corners[low, 1] - corners[mid, 1])
    rows[0] = first_centre(corners[top, 1], height)
    rows[1] = first_centre(corners[mid, 1], height)
    rows[2] = first_centre(corners[low, 1], height)


@kernel
def place_texture(corners, texels, setup):
    """Write the affine maps from screen to barycentrics and to texels (centres on integers)."""
    x1, y1 = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    x2, y2 = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    area = x1 * y2 - x2 * y1
    inverse = ONE / area if abs(area) > LEAST_AREA else ZERO
    setup[X_0], setup[Y_0] = corners[0, 0] - HALF, corners[0, 1] - HALF
    setup[B1_DX], setup[B1_DY] = y2 * inverse, -x2 * inverse
    setup[B2_DX], setup[B2_DY] = -y1 * inverse, x1 * inverse
    u1, v1 = texels[1, 0] - texels[0, 0], texels[1, 1] - texels[0, 1]
    u2, v2 = texels[2, 0] - texels[0, 0], texels[2, 1] - texels[0, 1]
    setup[U_0], setup[V_0] = texels[0, 0] - HALF, texels[0, 1] - HALF
    setup[DU_DX] = u1 * setup[B1_DX] + u2 * setup[B2_DX]
    setup[DU_DY] = u1 * setup[B1_DY] + u2 * setup[B2_DY]
    setup[DV_DX] = v1 * setup[B1_DX] + v2 * setup[B2_DX]
    setup[DV_DY] = v1 * setup[B1_DY] + v2 * setup[B2_DY]


@kernel
def place_triangles(vertices, triangles, uv, height, setup, rows):
    """Fill one row of ``setup`` and ``rows`` (first, middle, end) per triangle."""
    corners = np.empty((3, 2), np.float32)
    texels = np.empty((3, 2), np.float32)
    for triangle in range(triangles.shape[0]):
        for corner in range(3):
            vertex = triangles[triangle, corner]
            for axis in range(2):
                corners[corner, axis] = vertices[vertex, axis]
                texels[corner, axis] = uv[vertex, axis]
        place_edges(corners, setup[triangle], rows[triangle], height)
        place_texture(corners, texels, setup[triangle])


@exact_kernel
def span(setup, mid_row, row, width):
    """First and end column of a triangle in a row."""
    y = np.float32(row) + HALF
    x_long = setup[X_TOP] + (y - setup[Y_TOP]) * setup[SLOPE_LONG]
    if row < mid_row:
        x_short = setup[X_TOP] + (y - setup[Y_TOP]) * setup[SLOPE_UPPER]
    else:
        x_short = setup[X_MID] + (y - setup[Y_MID]) * setup[SLOPE_LOWER]
    return first_centre(min(x_long, x_short), width), first_centre(max(x_long, x_short), width)


@kernel
def last_texel(count):
    """Largest coordinate whose right neighbour is still inside: a hair under ``count - 1``."""
    return np.float32(count - 1) * (ONE - np.float32(2.4e-7))


@kernel
def composite_triangle(setup, rows, mark, opacity, texture, texture_size, width, stamp, out):
    """Put one triangle behind what ``out`` (flat RGBA) already shows."""
    texture_width, u_end, v_end = texture_size[0], last_texel(texture_size[0]), last_texel(texture_size[1])
    du, dv = setup[DU_DX], setup[DV_DX]
    for row in range(rows[0], rows[2]):
        begin, end = span(setup, rows[1], row, width)
        y = np.float32(row) - setup[Y_0]
        u_row, v_row = setup[U_0] + y * setup[DU_DY], setup[V_0] + y * setup[DV_DY]
        for column in range(begin, end):
            pixel = np.uint64(row * width + column)
            base = pixel << np.uint64(2)
            transmittance = ONE - out[base + np.uint64(3)]
            if transmittance < STOP or stamp[pixel] == mark:
                continue
            stamp[pixel] = mark
            x = np.float32(column) - setup[X_0]
            u, v = min(max(u_row + x * du, ZERO), u_end), min(max(v_row + x * dv, ZERO), v_end)
            u_texel, v_texel = np.int32(u), np.int32(v)
            fu, fv = u - np.float32(u_texel), v - np.float32(v_texel)
            upper = np.uint64((np.int64(v_texel) * texture_width + np.int64(u_texel)) << 2)
            lower = upper + np.uint64(texture_width << 2)
            weight = transmittance * opacity
            w11 = weight * fu * fv
            w10, w01 = weight * fu - w11, weight * fv - w11
            w00 = weight - w11 - w10 - w01
            for channel in range(4):
                c = np.uint64(channel)
                out[base + c] += (
                    w00 * texture[upper + c]
                    + w10 * texture[upper + np.uint64(4) + c]
                    + w01 * texture[lower + c]
                    + w11 * texture[lower + np.uint64(4) + c]
                )


@kernel
def composite(setup, rows, starts, order, opacity, texture, texture_size, width, stamp, out):
    """Render one frame into ``out`` (flat RGBA). ``stamp`` (one per pixel) is scratch."""
    out[:] = ZERO
    stamp[:] = 0
    for rank in range(len(order) - 1, -1, -1):
        layer = order[rank]
        for triangle in range(starts[layer], starts[layer + 1]):
            composite_triangle(
                setup[triangle], rows[triangle], rank + 1, opacity[layer], texture, texture_size, width, stamp, out
            )


@kernel
def composite_frames(first, end, vertices, triangles, starts, uv, order, opacity, texture, texture_size, size, out):
    """Render frames first..end of a batch into ``out`` (B, H * W * 4)."""
    setup = np.empty((len(triangles), NUM_COLUMNS), np.float32)
    rows = np.empty((len(triangles), 3), np.int64)
    stamp = np.empty(size[0] * size[1], np.uint16)
    for frame in range(first, end):
        place_triangles(vertices[frame], triangles, uv, size[1], setup, rows)
        composite(setup, rows, starts, order[frame], opacity[frame], texture, texture_size, size[0], stamp, out[frame])
