import numpy as np

from wildpuppet.track.smooth import LONGEST_BRIDGE, bridge, fill, regress, runs_of, share_in_picture, smooth

EXACT = 1e-9


def boxes_along(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points, np.tile([20.0, 30.0], (len(points), 1))], 1)


def test_a_steady_move_is_left_as_it_is_to_its_very_ends():
    values = np.stack([3.0 * np.arange(30) + 5.0, -0.7 * np.arange(30)], 1)
    assert np.abs(regress(values, np.ones(30), 4.0) - values).max() < EXACT


def test_noise_shrinks_as_the_square_root_of_the_frames_that_count():
    noise = np.random.default_rng(0).normal(0, 1, (4000, 1))
    expected = 1.0 / np.sqrt(2.0 * np.sqrt(np.pi) * 4.0)  # a Gaussian window of deviation 4 in the inside
    assert abs(regress(noise, np.ones(4000), 4.0).std() / expected - 1.0) < 0.1


def test_the_users_box_stays_exactly_and_draws_its_neighbours():
    boxes = boxes_along(np.zeros((21, 2)))
    boxes[10, 0] = 6.0
    result = smooth(boxes, np.zeros(21, int), 2.0, reference=10)
    assert np.array_equal(result[10], boxes[10])
    assert result[9, 0] > 1.0
    assert abs(result[0, 0]) < 0.5


def test_nothing_is_smoothed_across_a_cut():
    boxes = boxes_along(np.repeat([[0.0, 0.0], [100.0, 50.0]], 10, axis=0))
    result = smooth(boxes, np.repeat([0, 1], 10), 4.0, reference=0)
    assert np.abs(result - boxes).max() < EXACT


def test_a_short_gap_is_bridged_along_a_line_and_a_long_one_stays_lost():
    short = ["followed"] * 3 + ["lost"] * 4 + ["found"] + ["followed"] * 2
    state = bridge(short, np.zeros(10, int), np.ones(10))
    assert state == ["followed"] * 3 + ["bridged"] * 4 + ["followed"] * 3
    boxes = boxes_along(np.stack([10.0 * np.arange(10), np.zeros(10)], 1))
    known = boxes.copy()
    known[3:7, :2] = -999.0
    assert np.abs(fill(known, state) - boxes).max() < 1e-6
    long = ["followed", *["lost"] * (LONGEST_BRIDGE + 1), "found"]
    assert bridge(long, np.zeros(len(long), int), np.ones(len(long))) == long
    over_a_cut = ["followed", "lost", "found"]
    assert bridge(over_a_cut, np.array([0, 0, 1]), np.ones(3)) == over_a_cut


def test_a_gap_beside_which_the_character_leaves_the_picture_stays_lost():
    state = ["followed"] * 3 + ["lost"] * 4 + ["found"] + ["followed"] * 2
    boxes = boxes_along(np.stack([np.r_[60:-60:-24, -60:60:24], np.full(10, 50.0)], 1).astype(float))
    share = share_in_picture(boxes, (320, 200))
    assert share.max() == 1.0
    assert share[5] == 0.0
    assert bridge(state, np.zeros(10, int), share) == state


def test_runs_end_at_cuts_and_where_the_character_is_lost():
    state = ["followed", "followed", "lost", "lost", "found", "followed"]
    assert runs_of(state, np.array([0, 1, 1, 1, 1, 1])).tolist() == [0, 1, 2, 2, 3, 3]
