# mypy: disable-error-code="no-untyped-def"
# (Numba infers the types of kernels from their arguments.)
"""Numba kernel: a frame's pixel energy and its gradient in one go. See ``pixel_energy`` for the formula."""

import math

import numpy as np

from wildpuppet.render.gradient_kernels import walk
from wildpuppet.render.jit import kernel
from wildpuppet.render.kernels import NUM_COLUMNS, ONE, ZERO, composite, place_triangles


@kernel
def compare(image, target, covered_weight, uncovered_cost, epsilon, upstream):
    """Return one frame's energy and write its gradient by the image where the puppet covers anything."""
    energy = 0.0
    for index in range(len(covered_weight)):
        pixel, base = np.uint64(index), np.uint64(index) << np.uint64(2)
        alpha = image[base + np.uint64(3)]
        cost = uncovered_cost[pixel]
        energy += (ONE - alpha) * cost
        if alpha == ZERO:
            upstream[base], upstream[base + np.uint64(1)], upstream[base + np.uint64(2)] = ZERO, ZERO, ZERO
            upstream[base + np.uint64(3)] = -cost
            continue
        colour = np.uint64(3) * pixel
        square, by_alpha = ZERO, ZERO
        for channel in range(3):
            wanted = target[colour + np.uint64(channel)]
            difference = alpha * wanted - image[base + np.uint64(channel)]
            upstream[base + np.uint64(channel)] = -difference
            square += difference * difference
            by_alpha += difference * wanted
        weight = covered_weight[pixel]
        if epsilon > ZERO:
            root = np.float32(math.sqrt(square + epsilon * epsilon))
            energy += weight * (root - epsilon)
            slope = weight / root
        else:
            energy += weight * square
            slope = weight + weight
        for channel in range(3):
            upstream[base + np.uint64(channel)] *= slope
        upstream[base + np.uint64(3)] = slope * by_alpha - cost
    return energy


@kernel
def energy_frames(
    first, end, vertices, triangles, starts, uv, order, opacity, texture, texture_size, size,
    target, covered_weight, uncovered_cost, epsilon, energy, vertex_gradient,
):  # fmt: skip
    """Fill ``energy`` and add to ``vertex_gradient`` for frames first..end; pixels are flat per frame."""
    num_pixels = size[0] * size[1]
    setup = np.empty((len(triangles), NUM_COLUMNS), np.float32)
    rows = np.empty((len(triangles), 3), np.int64)
    stamp = np.empty(num_pixels, np.uint16)
    behind = np.empty(num_pixels * 2, np.float32)
    image = np.empty(num_pixels * 4, np.float32)
    upstream = np.empty(num_pixels * 4, np.float32)
    unused = np.empty(0, np.float32)
    opacity_gradient = np.empty(order.shape[1], np.float32)
    for frame in range(first, end):
        place_triangles(vertices[frame], triangles, uv, size[1], setup, rows)
        composite(setup, rows, starts, order[frame], opacity[frame], texture, texture_size, size[0], stamp, image)
        energy[frame] = compare(image, target[frame], covered_weight[frame], uncovered_cost[frame], epsilon, upstream)
        walk(
            setup, rows, triangles, starts, order[frame], opacity[frame], texture, texture_size, size[0],
            image, upstream, stamp, behind, vertex_gradient[frame], opacity_gradient, unused,
        )  # fmt: skip
