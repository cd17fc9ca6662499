"""The search's inner loops in Numba: template costs and min-plus convolutions on (angle, y, x) grids."""

import numpy as np
from jaxtyping import Float, Int
from numba import config, njit, prange

# OpenMP's threads spin while they wait: 3 to 4 times slower on a busy machine.
setattr(config, "THREADING_LAYER", "workqueue")  # noqa: B010 numba makes its settings at run time

RELAXED = {"nsz", "nnan"}
"""What the compiler may assume: no reordering of sums, so that a compiled and a cached kernel give the same bits."""


@njit(parallel=True, cache=True, fastmath=RELAXED)
def template_costs(
    disagreement: Float[np.ndarray, "C Hp Wp"],
    pixels: Int[np.ndarray, "P 3"],
    weights: Float[np.ndarray, "P"],
    start: Int[np.ndarray, "K"],
    count: Int[np.ndarray, "K"],
    reach: int,
    height: int,
    width: int,
) -> Float[np.ndarray, "K H W"]:
    """Sum disagreement over each turned template at every pivot position; maps are padded by ``reach`` all round."""
    num_angles = len(start)
    costs = np.zeros((num_angles, height, width), np.float32)
    for work in prange(num_angles * height):
        angle, y = work // height, work % height
        row = costs[angle, y]
        first, end = start[angle], start[angle] + count[angle]
        for p in range(first, end - 3, 4):  # the row is read and written a quarter as often
            _add_four(row, disagreement, pixels[p : p + 4], weights[p : p + 4], y + reach, reach)
        for p in range(end - (end - first) % 4, end):
            source, left = disagreement[pixels[p, 2], y + pixels[p, 0] + reach], pixels[p, 1] + reach
            for x in range(width):
                row[x] += weights[p] * source[left + x]
    return costs


@njit(cache=True, fastmath=RELAXED, inline="always")
def _add_four(
    row: Float[np.ndarray, "W"],
    disagreement: Float[np.ndarray, "C Hp Wp"],
    pixels: Int[np.ndarray, "4 3"],
    weights: Float[np.ndarray, "4"],
    top: int,
    left: int,
) -> None:
    """Add what lies under four of a template's pixels; unsigned places, so that the compiler sees no wrapping round."""
    under_a, under_b = disagreement[pixels[0, 2], top + pixels[0, 0]], disagreement[pixels[1, 2], top + pixels[1, 0]]
    under_c, under_d = disagreement[pixels[2, 2], top + pixels[2, 0]], disagreement[pixels[3, 2], top + pixels[3, 0]]
    a, b = np.uint64(left + pixels[0, 1]), np.uint64(left + pixels[1, 1])
    c, d = np.uint64(left + pixels[2, 1]), np.uint64(left + pixels[3, 1])
    weight_a, weight_b, weight_c, weight_d = weights[0], weights[1], weights[2], weights[3]
    for x in range(np.uint64(len(row))):
        row[x] = (
            row[x] + weight_a * under_a[a + x] + weight_b * under_b[b + x]
            + weight_c * under_c[c + x] + weight_d * under_d[d + x]
        )  # fmt: skip


def spring_transform(costs: Float[np.ndarray, "K H W"], pull: Float[np.ndarray, "R"]) -> Float[np.ndarray, "K H W"]:
    """Take, at every position, the least of cost + pull[|dx|] + pull[|dy|], within the table's reach.

    Where the table becomes a straight line after a convex start, as Huber's does, its long end is walked in strides
    of 1, 2, 4 ...: the least over a convex sum of costs is the sum's least one after the other.
    """
    near = _start_of_line(pull)
    strides: list[int] = []
    left = len(pull) - 1 - near
    while left:
        strides.append(min(left, 2 ** len(strides)))
        left -= strides[-1]
    slope = float(pull[-1] - pull[-2]) if len(pull) > 1 else 0.0
    return _spring_transform(costs, pull[: near + 1], np.array(strides, np.int64), slope)


def _start_of_line(pull: Float[np.ndarray, "R"]) -> int:
    """Find the gap from which a convex table is straight; its last one where it is not convex."""
    rises = np.diff(pull.astype(np.float64))
    noise = 1e-6 * float(np.abs(pull).max(initial=0))
    if len(rises) == 0 or (np.diff(rises) < -noise).any() or rises[0] < 0:
        return len(pull) - 1
    return int(np.flatnonzero(rises >= rises[-1] - noise)[0])


@njit(parallel=True, cache=True, fastmath=RELAXED)
def _spring_transform(
    costs: Float[np.ndarray, "K H W"], near: Float[np.ndarray, "n"], strides: Int[np.ndarray, "s"], slope: float
) -> Float[np.ndarray, "K H W"]:
    """Pull along rows, then along columns: first by the table ``near``, then by each stride at ``slope`` a pixel."""
    num_angles, height, width = costs.shape
    pad = len(near)
    for stride in strides:
        pad = max(pad, stride)
    result = np.empty_like(costs)
    for angle in prange(num_angles):
        row, next_row = np.full(width + 2 * pad, np.inf, np.float32), np.full(width + 2 * pad, np.inf, np.float32)
        plane = np.full((height + 2 * pad, width), np.inf, np.float32)
        next_plane = np.full((height + 2 * pad, width), np.inf, np.float32)
        for y in range(height):
            row[pad : pad + width] = costs[angle, y]
            _pull_by_table(row, next_row, near, pad, width)
            for stride in strides:
                row, next_row = next_row, row
                _pull_by_stride(row, next_row, stride, stride * slope, pad, width)
            plane[y + pad] = next_row[pad : pad + width]
        for y in range(pad, pad + height):
            next_plane[y] = plane[y]
            for step in range(1, len(near)):
                _least_of_three(next_plane[y], plane[y - step], plane[y + step], near[step])
        for stride in strides:
            plane, next_plane = next_plane, plane
            for y in range(pad, pad + height):
                next_plane[y] = plane[y]
                _least_of_three(next_plane[y], plane[y - stride], plane[y + stride], stride * slope)
        result[angle] = next_plane[pad : pad + height]
    return result


@njit(cache=True, fastmath=RELAXED, inline="always")
def _pull_by_table(
    row: Float[np.ndarray, "p"], result: Float[np.ndarray, "p"], near: Float[np.ndarray, "n"], pad: int, width: int
) -> None:
    result[pad : pad + width] = row[pad : pad + width]
    for step in range(1, len(near)):
        _pull_from(row, result, step, near[step], pad, width)


@njit(cache=True, fastmath=RELAXED, inline="always")
def _pull_by_stride(
    row: Float[np.ndarray, "p"], result: Float[np.ndarray, "p"], stride: int, extra: float, pad: int, width: int
) -> None:
    result[pad : pad + width] = row[pad : pad + width]
    _pull_from(row, result, stride, extra, pad, width)


@njit(cache=True, fastmath=RELAXED, inline="always")
def _pull_from(
    row: Float[np.ndarray, "p"], result: Float[np.ndarray, "p"], step: int, extra: float, pad: int, width: int
) -> None:
    end = pad + width
    _least_of_three(result[pad:end], row[pad - step : end - step], row[pad + step : end + step], extra)


@njit(cache=True, fastmath=RELAXED, inline="always")
def _least_of_three(
    best: Float[np.ndarray, "W"], before: Float[np.ndarray, "W"], after: Float[np.ndarray, "W"], extra: float
) -> None:
    pull = np.float32(extra)
    for x in range(len(best)):
        best[x] = min(best[x], min(before[x], after[x]) + pull)


@njit(cache=True, fastmath=RELAXED)
def least_near(
    costs: Float[np.ndarray, "K H W"], pivots: Int[np.ndarray, "K 2"], pull: Float[np.ndarray, "R"], outside: float
) -> tuple[Float[np.ndarray, "K"], Int[np.ndarray, "K 2"]]:
    """Find, for each angle, the least of cost + pull[|dx|] + pull[|dy|] around its pivot, and its place (x, y)."""
    num_angles, height, width = costs.shape
    least, place = np.full(num_angles, np.inf, np.float32), np.zeros((num_angles, 2), np.int64)
    reach = len(pull) - 1
    for angle in range(num_angles):
        for dy in range(-reach, reach + 1):
            y = pivots[angle, 1] + dy
            for dx in range(-reach, reach + 1):
                x = pivots[angle, 0] + dx
                inside = 0 <= x < width and 0 <= y < height
                total = (costs[angle, y, x] if inside else np.float32(outside)) + (pull[abs(dy)] + pull[abs(dx)])
                if total < least[angle]:
                    least[angle] = total
                    place[angle] = x, y
    return least, place


@njit(parallel=True, cache=True, fastmath=RELAXED)
def turn_transform(costs: Float[np.ndarray, "K H W"], turn_cost: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K H W"]:
    """Take, for every parent's angle, the least over the child's angles of cost + turn_cost[child - parent]."""
    num_angles, height, width = costs.shape
    result = np.empty_like(costs)
    for y in prange(height):
        for parent in range(num_angles):
            best = result[parent, y]
            best[:] = np.inf
            for child in range(num_angles):
                extra = turn_cost[(child - parent) % num_angles]
                if extra < 1e8:
                    row = costs[child, y]
                    for x in range(width):
                        best[x] = min(best[x], row[x] + extra)
    return result


@njit(parallel=True, cache=True)
def shift_each(
    costs: Float[np.ndarray, "K H W"], offsets: Int[np.ndarray, "K 2"], outside: float
) -> Float[np.ndarray, "K H W"]:
    """Read each angle's map at ``position + offsets[angle]`` (x, y); ``outside`` where that leaves the map."""
    num_angles, height, width = costs.shape
    result = np.empty_like(costs)
    for angle in prange(num_angles):
        dx, dy = offsets[angle, 0], offsets[angle, 1]
        for y in range(height):
            source = y + dy
            if source < 0 or source >= height:
                result[angle, y, :] = outside
                continue
            for x in range(width):
                from_x = x + dx
                result[angle, y, x] = costs[angle, source, from_x] if 0 <= from_x < width else outside
    return result


@njit(parallel=True, cache=True, fastmath=RELAXED)
def composite_costs(
    pictures: Float[np.ndarray, "B H W 4"],
    lab: Float[np.ndarray, "H W 3"],
    behind: Float[np.ndarray, "H W"],
    unexplained: Float[np.ndarray, "H W"],
    unit: float,
    wrong: Float[np.ndarray, "R"],
    per_step: float,
) -> Float[np.ndarray, "B H"]:
    """Sum, along rows, what covered and uncovered pixels cost (see ``evidence``).

    ``pictures`` are premultiplied, in units of ``unit``; ``wrong[k]`` is the disagreement at a squared distance of
    k / per_step (the last entry for all beyond).
    """
    num_pictures, height, width = pictures.shape[:3]
    costs = np.zeros((num_pictures, height))
    for work in prange(num_pictures * height):
        picture, y = work // height, work % height
        total = 0.0
        for x in range(width):
            alpha = pictures[picture, y, x, 3]
            if alpha < 1e-3:
                total += unexplained[y, x]
                continue
            scale = unit / alpha
            squared = (pictures[picture, y, x, 0] * scale - lab[y, x, 0]) ** 2
            squared += (pictures[picture, y, x, 1] * scale - lab[y, x, 1]) ** 2
            squared += (pictures[picture, y, x, 2] * scale - lab[y, x, 2]) ** 2
            entry = min(int(squared * per_step), len(wrong) - 1)
            total += alpha * (wrong[entry] + behind[y, x]) + (1 - alpha) * unexplained[y, x]
        costs[picture, y] = total
    return costs
