# mypy: disable-error-code="no-untyped-def"
# (Numba infers the types of kernels from their arguments.)
"""Numba kernels: the gradient of a composited frame to vertices, texture and opacity (idea: see ``kernels.py``)."""

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
    STOP,
    U_0,
    V_0,
    X_0,
    Y_0,
    ZERO,
    last_texel,
    place_triangles,
    span,
)

ONE_TEXEL = np.uint64(4)
ALPHA = np.uint64(3)


@kernel
def dot(a, a_base, b, b_base):
    """Dot product of two RGBA values in flat arrays."""
    total = ZERO
    for channel in range(4):
        total += a[a_base + np.uint64(channel)] * b[b_base + np.uint64(channel)]
    return total


@kernel
def add_texel(texture_gradient, base, upstream, upstream_base, weight, alpha_gradient):
    """Add one fragment's share to the gradient of one texel."""
    for channel in range(4):
        texture_gradient[base + np.uint64(channel)] += weight * upstream[upstream_base + np.uint64(channel)]
    texture_gradient[base + ALPHA] += alpha_gradient


@kernel
def walk_triangle(
    setup, rows, mark, opacity, texture, texture_size, width, image, upstream, stamp, behind, texture_gradient, sums
):
    """Sum dL/d(u, v) and its products with x and y over one triangle's pixels; return dL/d opacity.

    ``behind`` holds two numbers per pixel: what is covered so far, and G . (R_final - R_so_far). ``sums`` gets
    (gu, gv, gu x, gv x, gu y, gv y), x and y from the triangle's first corner.
    """
    texture_width, u_end, v_end = texture_size[0], last_texel(texture_size[0]), last_texel(texture_size[1])
    du, dv = setup[DU_DX], setup[DV_DX]
    opacity_gradient = ZERO
    sums[:] = ZERO
    for row in range(rows[0], rows[2]):
        begin, end = span(setup, rows[1], row, width)
        y = np.float32(row) - setup[Y_0]
        u_row, v_row = setup[U_0] + y * setup[DU_DY], setup[V_0] + y * setup[DV_DY]
        gu, gv, gux, gvx = ZERO, ZERO, ZERO, ZERO
        for column in range(begin, end):
            pixel = np.uint64(row * width + column)
            base, state = pixel << np.uint64(2), pixel << np.uint64(1)
            if stamp[pixel] == mark:
                continue
            if stamp[pixel] == 0:
                covered, rest = ZERO, dot(image, base, upstream, base)
            else:
                covered, rest = behind[state], behind[state + np.uint64(1)]
            transmittance = ONE - covered
            if transmittance < STOP:
                continue
            stamp[pixel] = mark
            x = np.float32(column) - setup[X_0]
            u_free, v_free = u_row + x * du, v_row + x * dv
            u, v = min(max(u_free, ZERO), u_end), min(max(v_free, ZERO), v_end)
            u_texel, v_texel = np.int32(u), np.int32(v)
            fu, fv = u - np.float32(u_texel), v - np.float32(v_texel)
            upper = np.uint64((np.int64(v_texel) * texture_width + np.int64(u_texel)) << 2)
            lower = upper + np.uint64(texture_width << 2)
            q00, q10 = dot(texture, upper, upstream, base), dot(texture, upper + ONE_TEXEL, upstream, base)
            q01, q11 = dot(texture, lower, upstream, base), dot(texture, lower + ONE_TEXEL, upstream, base)
            a00, a10 = texture[upper + ALPHA], texture[upper + ONE_TEXEL + ALPHA]
            a01, a11 = texture[lower + ALPHA], texture[lower + ONE_TEXEL + ALPHA]
            q0, q1 = q00 + fu * (q10 - q00), q01 + fu * (q11 - q01)
            a0, a1 = a00 + fu * (a10 - a00), a01 + fu * (a11 - a01)
            colour, alpha = q0 + fv * (q1 - q0), a0 + fv * (a1 - a0)
            weight = transmittance * opacity
            rest -= weight * colour
            behind[state], behind[state + np.uint64(1)] = covered + weight * alpha, rest
            left = ONE - opacity * alpha
            hidden = rest / left if transmittance * left >= STOP else ZERO
            opacity_gradient += transmittance * colour - alpha * hidden
            hidden *= -opacity
            if len(texture_gradient) > 0:
                w11 = fu * fv
                w10, w01 = fu - w11, fv - w11
                w00 = ONE - w11 - w10 - w01
                add_texel(texture_gradient, upper, upstream, base, w00 * weight, w00 * hidden)
                add_texel(texture_gradient, upper + ONE_TEXEL, upstream, base, w10 * weight, w10 * hidden)
                add_texel(texture_gradient, lower, upstream, base, w01 * weight, w01 * hidden)
                add_texel(texture_gradient, lower + ONE_TEXEL, upstream, base, w11 * weight, w11 * hidden)
            s00, s10 = weight * q00 + hidden * a00, weight * q10 + hidden * a10
            s01, s11 = weight * q01 + hidden * a01, weight * q11 + hidden * a11
            to_u = s10 - s00 + fv * (s11 - s01 - s10 + s00) if u == u_free else ZERO
            to_v = s01 - s00 + fu * (s11 - s10 - s01 + s00) if v == v_free else ZERO
            gu += to_u
            gv += to_v
            gux += to_u * x
            gvx += to_v * x
        sums[0] += gu
        sums[1] += gv
        sums[2] += gux
        sums[3] += gvx
        sums[4] += gu * y
        sums[5] += gv * y
    return opacity_gradient


@kernel
def spread(setup, corners, sums, vertex_gradient):
    """Give a triangle's corners their gradient: -b_i J^T dL/d(u, v), summed over its pixels."""
    for axis in range(2):
        du, dv = (setup[DU_DX], setup[DV_DX]) if axis == 0 else (setup[DU_DY], setup[DV_DY])
        plain = du * sums[0] + dv * sums[1]
        by_x = du * sums[2] + dv * sums[3]
        by_y = du * sums[4] + dv * sums[5]
        second = setup[B1_DX] * by_x + setup[B1_DY] * by_y
        third = setup[B2_DX] * by_x + setup[B2_DY] * by_y
        vertex_gradient[corners[0], axis] -= plain - second - third
        vertex_gradient[corners[1], axis] -= second
        vertex_gradient[corners[2], axis] -= third


@kernel
def walk(
    setup, rows, triangles, starts, order, opacity, texture, texture_size, width, image, upstream,
    stamp, behind, vertex_gradient, opacity_gradient, texture_gradient,
):  # fmt: skip
    """Add one frame's gradients. ``image`` is what ``composite`` rendered, ``upstream`` dL/d image, both flat."""
    stamp[:] = 0
    sums = np.empty(6, np.float32)
    for rank in range(len(order) - 1, -1, -1):
        layer = order[rank]
        for triangle in range(starts[layer], starts[layer + 1]):
            opacity_gradient[layer] += walk_triangle(
                setup[triangle], rows[triangle], rank + 1, opacity[layer], texture, texture_size, width,
                image, upstream, stamp, behind, texture_gradient, sums,
            )  # fmt: skip
            spread(setup[triangle], triangles[triangle], sums, vertex_gradient)


@kernel
def walk_frames(
    first, end, vertices, triangles, starts, uv, order, opacity, texture, texture_size, size, images, upstream,
    vertex_gradient, opacity_gradient, texture_gradient,
):  # fmt: skip
    """Add the gradients of frames first..end; ``texture_gradient`` (flat, may be empty) is shared by them."""
    setup = np.empty((len(triangles), NUM_COLUMNS), np.float32)
    rows = np.empty((len(triangles), 3), np.int64)
    stamp = np.empty(size[0] * size[1], np.uint16)
    behind = np.empty(size[0] * size[1] * 2, np.float32)
    for frame in range(first, end):
        place_triangles(vertices[frame], triangles, uv, size[1], setup, rows)
        walk(
            setup, rows, triangles, starts, order[frame], opacity[frame], texture, texture_size, size[0],
            images[frame], upstream[frame], stamp, behind,
            vertex_gradient[frame], opacity_gradient[frame], texture_gradient,
        )  # fmt: skip
