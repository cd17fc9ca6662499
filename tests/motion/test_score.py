from dataclasses import replace

import numpy as np
import pytest

from tests.motion.dolls import Doll, figure, run_of, truth_of, walk
from wildpuppet.motion.lines import chamfer
from wildpuppet.motion.score import LeftOut, leave_one_out

FRAMES, SIZE = 20, (360, 280)


@pytest.fixture(scope="module")
def doll() -> Doll:
    return figure()


@pytest.fixture(scope="module")
def scores(doll: Doll) -> LeftOut:
    poses = walk(doll, FRAMES)
    crops, fit = run_of(doll, poses, SIZE)
    return leave_one_out(doll.puppet, crops, fit, truth_of(doll, poses))


def test_left_out_drawings_of_a_walk_are_met_better_than_by_both_baselines(scores: LeftOut) -> None:
    assert len(scores.frames) == FRAMES - 2
    for measure in ("vertices", "points", "true_points", "lines"):
        assert scores.ratio("ours", measure) < 0.6, measure
    assert scores.table()["fit_points"]["fit"] < 0.01


def test_where_the_fit_is_noise_no_method_is_praised(doll: Doll) -> None:
    """Every fit is off by as much as the motion itself: curves must not swing after it."""
    poses = walk(doll, FRAMES)
    noisy = poses + np.random.default_rng(0).normal(0, 6.0, (FRAMES, 1, 2))
    crops, fit = run_of(doll, noisy, SIZE)
    scores = leave_one_out(doll.puppet, crops, fit, truth_of(doll, poses))
    assert scores.ratio("ours", "points") < 1.1
    assert scores.table()["fit_points"]["fit"] > 3.0
    assert scores.ratio("ours", "true_points") < 0.6


def test_neighbours_of_another_motion_are_skipped(doll: Doll) -> None:
    poses = np.concatenate([walk(doll, 8), walk(doll, 8) + np.array([150.0, 0.0])])
    crops, fit = run_of(doll, poses, (600, 280))
    scores = leave_one_out(doll.puppet, crops, fit)
    assert scores.skipped == 2
    assert set(scores.frames) == set(range(1, 15)) - {7, 8}
    lost = replace(fit, state=tuple("lost" if t == 4 else "fitted" for t in range(16)))
    assert set(leave_one_out(doll.puppet, crops, lost, only=(2, 3, 5, 6)).frames) == {2, 6}


def test_distance_of_lines_is_their_distance() -> None:
    first, second = np.zeros((40, 60), bool), np.zeros((40, 60), bool)
    first[:, 10], second[:, 17] = True, True
    assert chamfer(first, second) == pytest.approx(7.0, abs=0.05)
    assert chamfer(first, first) == 0.0
    second[:, 10] = True
    assert chamfer(first, second) == pytest.approx(7.0 / 4.0, abs=0.05)
