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


@njit(parallel=True, cache=True, fastmath=RELAXED)
def spring_transform(costs: Float[np.ndarray, "K H W"], pull: Float[np.ndarray, "R"]) -> Float[np.ndarray, "K H W"]:
    """Take, at every position, the least of cost + pull[|dx|] + pull[|dy|], within the table's reach."""
    num_angles, height = costs.shape[:2]
    along = np.empty_like(costs)
    result = np.empty_like(costs)
    for angle in prange(num_angles):
        for y in range(height):
            _pull_along_row(costs, along, angle, y, pull)
        for y in range(height):
            _pull_along_columns(along, result, angle, y, pull)
    return result


@njit(cache=True, fastmath=True)
def _pull_along_row(
    costs: Float[np.ndarray, "K H W"],
    result: Float[np.ndarray, "K H W"],
    angle: int,
    y: int,
    pull: Float[np.ndarray, "R"],
) -> None:
    width = costs.shape[2]
    for x in range(width):
        result[angle, y, x] = costs[angle, y, x]
    for step in range(1, len(pull)):
        extra = pull[step]
        for x in range(width - step):
            result[angle, y, x] = min(result[angle, y, x], costs[angle, y, x + step] + extra)
        for x in range(step, width):
            result[angle, y, x] = min(result[angle, y, x], costs[angle, y, x - step] + extra)


@njit(cache=True, fastmath=True)
def _pull_along_columns(
    costs: Float[np.ndarray, "K H W"],
    result: Float[np.ndarray, "K H W"],
    angle: int,
    y: int,
    pull: Float[np.ndarray, "R"],
) -> None:
    height, width = costs.shape[1:]
    for x in range(width):
        result[angle, y, x] = costs[angle, y, x]
    for step in range(1, len(pull)):
        extra = pull[step]
        if y + step < height:
            for x in range(width):
                result[angle, y, x] = min(result[angle, y, x], costs[angle, y + step, x] + extra)
        if y - step >= 0:
            for x in range(width):
                result[angle, y, x] = min(result[angle, y, x], costs[angle, y - step, x] + extra)


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
