"""The compiled loop behind ``plate.py``: a median over pictures, each pixel over those that show it."""

import numpy as np
from jaxtyping import Int, UInt8
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def lower_median(values: Int[np.ndarray, " m"], count: int, bins: Int[np.ndarray, "16"]) -> int:
    """Select the lower median of the first ``count`` values (0..255): first its sixteen, then its place in them."""
    rank = (count - 1) // 2
    bins[:] = 0
    for k in range(count):
        bins[values[k] >> 4] += 1
    coarse = 0
    while rank >= bins[coarse]:
        rank -= bins[coarse]
        coarse += 1
    bins[:] = 0
    for k in range(count):
        if values[k] >> 4 == coarse:
            bins[values[k] & 15] += 1
    fine = 0
    while rank >= bins[fine]:
        rank -= bins[fine]
        fine += 1
    return 16 * coarse + fine


@njit(cache=True, nogil=True)
def masked_median(
    stack: UInt8[np.ndarray, "m h w 3"], seen: UInt8[np.ndarray, "m h w"]
) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
    """Return the lower median of what is seen, the largest channel's median deviation from it, and the number seen.

    Where nothing is seen: 0, 255 and 0.
    """
    num, height, width = seen.shape
    median = np.zeros((height, width, 3), np.uint8)
    spread = np.full((height, width), 255, np.uint8)
    count = np.zeros((height, width), np.uint8)
    chosen = np.empty(num, np.int64)
    values = np.empty(num, np.int64)
    deviation = np.empty(num, np.int64)
    bins = np.empty(16, np.int64)
    for y in range(height):
        for x in range(width):
            found = 0
            for t in range(num):
                if seen[t, y, x] > 0:
                    chosen[found] = t
                    found += 1
            count[y, x] = found
            if found == 0:
                continue
            deviation[:found] = 0
            for channel in range(3):
                for k in range(found):
                    values[k] = stack[chosen[k], y, x, channel]
                middle = lower_median(values, found, bins)
                median[y, x, channel] = middle
                for k in range(found):
                    deviation[k] = max(deviation[k], abs(values[k] - middle))
            spread[y, x] = lower_median(deviation, found, bins)
    return median, spread, count
