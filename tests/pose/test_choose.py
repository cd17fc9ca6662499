import dataclasses
import itertools

import numpy as np
import pytest

from tests.pose.boxes import box_puppet, crops_around
from wildpuppet.machine import Machine
from wildpuppet.pose.choose import best_path, choose, steadiest_path
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Hypotheses, Poses, Puppet

PUPPET = box_puppet([(24, 4, 14, 24), (24, 26, 5, 18), (33, 26, 5, 18)], [(0, 1, (26.5, 27.0)), (0, 2, (35.5, 27.0))])
"""A body and two legs."""
NUM = 7
SWAPPED_AT = 3


def two_hypotheses(cost: np.ndarray) -> Hypotheses:
    """In every frame the true pose, gently walking to the right, and the same with the legs swapped; best first.

    ``cost[t]`` is of the true and of the swapped pose.
    """
    maps = np.zeros((NUM, 2, 3, 2, 3))
    maps[..., 0, 0] = maps[..., 1, 1] = 1.0
    maps[..., 0, 2] += np.arange(NUM)[:, None, None]
    maps[:, 1, 1, 0, 2] += 9.0
    maps[:, 1, 2, 0, 2] -= 9.0
    best_first = np.argsort(cost, axis=1, kind="stable")
    rows = np.arange(NUM)[:, None]
    return Hypotheses(maps[rows, best_first], np.tile(np.arange(3), (NUM, 2, 1)), cost[rows, best_first])


def swap_preferred_once() -> np.ndarray:
    """Costs that take the swap for the better pose in one frame only."""
    cost = np.tile([1.0, 1.3], (NUM, 1))
    cost[SWAPPED_AT] = [1.25, 1.0]
    return cost


def chosen(poses: Poses) -> list[int]:
    """Which hypothesis was chosen in each frame: 0 true, 1 swapped."""
    return [int(maps[1, 0, 2] - maps[0, 0, 2] > 4) for maps in poses.crop_from_canvas]


def choose_among(cost: np.ndarray, crops: Crops, puppet: Puppet = PUPPET, **settings: float) -> Poses:
    return choose(puppet, crops, two_hypotheses(cost), SearchSettings(**settings), Machine())


@pytest.mark.parametrize("seed", range(4))
def test_best_path_is_the_best_of_all_paths(seed):
    draw = np.random.default_rng(seed)
    costs, steps = draw.uniform(0, 1, (5, 3)), list(draw.uniform(0, 1, (4, 3, 3)))

    def total(path: tuple[int, ...]) -> float:
        own = sum(costs[t, i] for t, i in enumerate(path))
        return own + sum(step[i, j] for step, i, j in zip(steps, path[:-1], path[1:], strict=True))

    best = min(itertools.product(range(3), repeat=5), key=total)
    assert tuple(best_path(costs, steps)) == best
    assert tuple(best_path(costs[:1], [])) == (costs[0].argmin(),)


def test_time_undoes_a_swap_of_one_frame():
    poses = choose_among(swap_preferred_once(), crops_around(NUM))
    assert chosen(poses) == [0] * NUM
    np.testing.assert_allclose(poses.cost, swap_preferred_once()[:, 0])
    expected = np.full(NUM, 0.3)
    expected[SWAPPED_AT] = -0.25
    np.testing.assert_allclose(poses.margin, expected)


def test_without_time_each_frame_takes_its_best():
    alone = [int(t == SWAPPED_AT) for t in range(NUM)]
    assert chosen(choose_among(swap_preferred_once(), crops_around(NUM), time_weight=0.0)) == alone
    unordered = dataclasses.replace(crops_around(NUM), ordered=False, reference=None)
    assert chosen(choose_among(swap_preferred_once(), unordered)) == alone


def test_strong_evidence_overrules_time():
    cost = swap_preferred_once()
    cost[SWAPPED_AT, 0] = 50.0
    assert chosen(choose_among(cost, crops_around(NUM)))[SWAPPED_AT] == 1


def test_a_cut_costs_nothing():
    cost = np.tile([1.0, 1.01], (NUM, 1))
    cost[SWAPPED_AT:] = [1.01, 1.0]
    after_cut = [int(t >= SWAPPED_AT) for t in range(NUM)]
    cut = crops_around(NUM, shot=after_cut)
    assert chosen(choose_among(cost, cut)) == after_cut
    assert len(set(chosen(choose_among(cost, crops_around(NUM))))) == 1


def test_frames_of_one_drawing_take_one_choice():
    drawing = np.array([0, 0, 1, 1, 1, 2, 2])
    cost = np.array([[1.0, 9.0], [9.0, 1.0], [1.0, 9.0]])[drawing]
    held = crops_around(NUM, drawing=drawing)
    assert chosen(choose_among(cost, held)) == [0, 0, 1, 1, 1, 0, 0]


def test_a_moving_window_is_not_movement():
    windows = crops_around(NUM).video_from_crop.copy()
    windows[:, 0, 2] = 30.0 * np.arange(NUM) % 77  # windows jump about; the character walks on in the video
    hypotheses = two_hypotheses(swap_preferred_once())
    maps = hypotheses.crop_from_canvas.copy()
    maps[..., 0, 2] -= windows[:, None, None, 0, 2]
    hypotheses = dataclasses.replace(hypotheses, crop_from_canvas=maps)
    crops = crops_around(NUM, video_from_crop=windows)
    assert chosen(choose(PUPPET, crops, hypotheses, SearchSettings(), Machine())) == [0] * NUM


def test_a_moving_camera_is_not_movement():
    windows = crops_around(NUM).video_from_crop.copy()
    windows[:, 0, 2] = 30.0 * np.arange(NUM)  # a fast pan: the window follows the character, which walks on in it
    crops = crops_around(NUM, video_from_crop=windows)
    assert chosen(choose_among(swap_preferred_once(), crops)) == [0] * NUM


def test_one_hypothesis_is_beyond_doubt():
    both = two_hypotheses(swap_preferred_once())
    one = Hypotheses(both.crop_from_canvas[:, :1], both.order[:, :1], both.cost[:, :1])
    poses = choose(PUPPET, crops_around(NUM), one, SearchSettings(), Machine())
    assert np.isinf(poses.margin).all()
    np.testing.assert_array_equal(poses.crop_from_canvas, one.crop_from_canvas[:, 0])


@pytest.mark.parametrize("seed", range(4))
def test_steadiest_path_is_the_best_of_all_paths(seed):
    draw = np.random.default_rng(seed)
    costs, steps, changes = (
        draw.uniform(0, 1, (5, 3)),
        list(draw.uniform(0, 1, (4, 3, 3))),
        draw.uniform(0, 1, (3, 3, 3, 3)),
    )

    def total(path: tuple[int, ...]) -> float:
        own = sum(costs[t, i] for t, i in enumerate(path))
        own += sum(step[i, j] for step, i, j in zip(steps, path[:-1], path[1:], strict=True))
        return own + sum(change[path[t : t + 3]] for t, change in enumerate(changes))

    best = min(itertools.product(range(3), repeat=5), key=total)
    assert tuple(steadiest_path(costs, steps, changes)) == best
    assert tuple(steadiest_path(costs[:2], steps[:1], [])) == tuple(best_path(costs[:2], steps[:1]))


def test_legs_that_pass_each_other_go_on():
    """In the fourth frame one leg covers the other; a swap from there on costs less and moves as little."""
    maps = two_hypotheses(np.tile([0.0, 1.0], (NUM, 1))).crop_from_canvas
    apart = 9.0 - 3.0 * np.arange(NUM)
    maps[:, 0, 1, 0, 2] += (9.0 - apart) / 2
    maps[:, 0, 2, 0, 2] -= (9.0 - apart) / 2
    maps[:, 1] = maps[:, 0]
    maps[:, 1, 1, 0, 2] += apart
    maps[:, 1, 2, 0, 2] -= apart
    cost = np.where(np.arange(NUM)[:, None] <= NUM // 2, [0.0, 1.0], [0.05, 0.0])
    hypotheses = Hypotheses(maps, np.tile(np.arange(3), (NUM, 2, 1)), cost)
    poses = choose(PUPPET, crops_around(NUM), hypotheses, SearchSettings(), Machine())
    np.testing.assert_array_equal(poses.crop_from_canvas, maps[:, 0])
