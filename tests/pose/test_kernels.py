import itertools

import numpy as np
import pytest

from wildpuppet.pose.dynamic import pull_table
from wildpuppet.pose.kernels import shift_each, spring_transform, template_costs, turn_transform

SHAPE = (5, 6, 7)
"""Angles, rows, columns: all different, so that swapped axes show."""


def random_costs(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, SHAPE).astype(np.float32)


def states():
    return itertools.product(*map(range, SHAPE))


def test_template_costs_sum_the_maps_under_the_pixels():
    draw = np.random.default_rng(1)
    _, height, width = SHAPE
    reach, count = 3, np.array([4, 1, 0, 6, 2])
    maps = draw.uniform(-1, 1, (3, height + 2 * reach, width + 2 * reach)).astype(np.float32)
    pixels = np.concatenate([draw.integers(-reach, reach + 1, (13, 2)), draw.integers(0, 3, (13, 1))], 1)
    weights, start = draw.uniform(0, 1, 13).astype(np.float32), np.cumsum(count) - count
    found = template_costs(maps, pixels.astype(np.int32), weights, start, count, reach, height, width)
    expected = np.zeros(SHAPE)
    for angle, y, x in states():
        for i in range(start[angle], start[angle] + count[angle]):
            dy, dx, colour = pixels[i]
            expected[angle, y, x] += weights[i] * maps[colour, y + dy + reach, x + dx + reach]
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize(
    "pull",
    [
        np.array([0.0, 0.1, 0.35, 0.5], np.float32),  # not convex
        np.zeros(1, np.float32),
        pull_table(0.5, 0.1, 1),
        pull_table(0.5, 0.1, 4),
        pull_table(2.5, 0.1, 3),
        pull_table(2.5, 0.1, 6),
        pull_table(1.5, 0.02, 20),
    ],
)
def test_spring_transform_is_the_least_over_all_gaps_within_reach(pull):
    costs, expected = random_costs(), np.full(SHAPE, np.inf)
    for angle, y, x in states():
        for row, column in itertools.product(range(SHAPE[1]), range(SHAPE[2])):
            if max(abs(row - y), abs(column - x)) < len(pull):
                through = costs[angle, row, column] + pull[abs(row - y)] + pull[abs(column - x)]
                expected[angle, y, x] = min(expected[angle, y, x], through)
    np.testing.assert_allclose(spring_transform(costs, pull), expected, atol=1e-6)


def test_turn_transform_is_the_least_over_the_childs_angles():
    costs = random_costs()
    turn = np.array([0.0, 0.3, 1.0, 0.7, 0.2], np.float32)  # not symmetric: the sign of the turn shows
    expected = np.full(SHAPE, np.inf)
    for angle, y, x in states():
        for child in range(SHAPE[0]):
            expected[angle, y, x] = min(expected[angle, y, x], costs[child, y, x] + turn[(child - angle) % SHAPE[0]])
    np.testing.assert_allclose(turn_transform(costs, turn), expected, atol=1e-6)


def test_shift_each_reads_beside_and_pays_outside():
    costs = random_costs()
    offsets = np.array([[0, 0], [2, -1], [-3, 4], [20, 0], [0, -9]])
    expected = np.full(SHAPE, 4.0)
    for angle, y, x in states():
        row, column = y + offsets[angle, 1], x + offsets[angle, 0]
        if 0 <= row < SHAPE[1] and 0 <= column < SHAPE[2]:
            expected[angle, y, x] = costs[angle, row, column]
    np.testing.assert_allclose(shift_each(costs, offsets, 4.0), expected, atol=1e-6)
