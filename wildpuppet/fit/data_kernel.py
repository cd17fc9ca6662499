# mypy: disable-error-code="no-untyped-def"
# (Numba infers the types of kernels from their arguments.)
"""The Numba kernels of the data term: each pixel's two prices, and their gradient to the rendered pixel."""

import numpy as np

from wildpuppet.render.jit import kernel

WHITE, ONE, THIRD = np.float32(255.0), np.float32(1.0), np.float32(1.0 / 3.0)


@kernel
def add_prices(first, end, rendered, colour, gain, limit, robust, coverage):
    """Sum the prices of frames first..end; images are flat, ``limit`` in squared grey levels."""
    for frame in range(first, end):
        seen, target, worth = rendered[frame], colour[frame], gain[frame]
        wrong, uncovered = 0.0, 0.0
        for pixel in range(len(worth)):
            alpha = seen[4 * pixel + 3]
            squares = np.float32(0.0)
            for channel in range(3):
                difference = target[3 * pixel + channel] * alpha - WHITE * seen[4 * pixel + channel]
                squares += difference * difference
            squares *= THIRD
            wrong += squares / (ONE + squares / limit)
            uncovered += max(worth[pixel], np.float32(0.0)) - worth[pixel] * alpha
        robust[frame], coverage[frame] = wrong, uncovered


@kernel
def add_slopes(first, end, rendered, colour, gain, limit, to_robust, to_coverage, gradient):
    """Fill ``gradient`` (flat RGBA) for frames first..end, given the gradient to each frame's two sums."""
    differences = np.empty(3, np.float32)
    for frame in range(first, end):
        seen, target, worth, slopes = rendered[frame], colour[frame], gain[frame], gradient[frame]
        for pixel in range(len(worth)):
            alpha = seen[4 * pixel + 3]
            squares, along = np.float32(0.0), np.float32(0.0)
            for channel in range(3):
                aim = target[3 * pixel + channel]
                differences[channel] = aim * alpha - WHITE * seen[4 * pixel + channel]
                squares += differences[channel] * differences[channel]
                along += differences[channel] * aim
            damped = ONE + squares * THIRD / limit
            slope = np.float32(2.0) * THIRD * to_robust[frame] / (damped * damped)
            for channel in range(3):
                slopes[4 * pixel + channel] = -slope * WHITE * differences[channel]
            slopes[4 * pixel + 3] = slope * along - to_coverage[frame] * worth[pixel]
