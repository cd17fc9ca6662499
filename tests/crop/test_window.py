import numpy as np
import pytest

from wildpuppet.crop.window import taut_string, windows_of, zoom_path
from wildpuppet.geometry import affine
from wildpuppet.settings import CropSettings


def length(path: np.ndarray) -> float:
    return float(np.hypot(np.diff(path), 1.0).sum())


def boxes_at(centres: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([centres - sizes / 2, sizes], 1)


def test_a_string_stands_still_where_it_can():
    values = np.sin(np.arange(40))
    assert np.ptp(taut_string(values - 1.0, values + 1.0)) == 0.0


def test_a_string_stays_in_its_tube_and_is_no_longer_than_any_other_path():
    draw = np.random.default_rng(0)
    for _ in range(20):
        middle = np.cumsum(draw.normal(0, 1, 60))
        low, high = middle - draw.uniform(0.1, 2.0, 60), middle + draw.uniform(0.1, 2.0, 60)
        path = taut_string(low, high)
        assert (path >= low - 1e-9).all()
        assert (path <= high + 1e-9).all()
        for _ in range(30):
            other = np.clip(
                path + draw.normal(0, 0.1) * np.exp(-((np.arange(60) - draw.integers(60)) ** 2) / 20), low, high
            )
            assert length(path) <= length(other) + 1e-9


def test_a_string_goes_straight_across_a_ramp():
    ramp = np.r_[np.zeros(10), np.linspace(0, 10, 21), np.full(10, 10.0)]
    path = taut_string(ramp - 1.0, ramp + 1.0)
    assert path[0] == pytest.approx(1.0)
    assert path[-1] == pytest.approx(9.0)
    assert np.diff(path).min() >= -1e-12
    assert np.diff(path).max() < 0.5


def test_the_reference_box_gets_its_pixels_and_all_windows_one_even_size():
    centres = np.stack([np.linspace(200, 900, 50), np.full(50, 300.0)], 1)
    boxes = boxes_at(centres, np.tile([120.0, 320.0], (50, 1)))
    windows = windows_of(boxes, np.zeros(50, int), 10, CropSettings(box_pixels=160, margin=0.25))
    scale = 1.0 / windows.video_from_crop[10, 0, 0]
    assert scale * 320.0 == pytest.approx(160.0)
    assert windows.size == (140, 240)  # (120 + 2 * 80) / 2 and (320 + 2 * 80) / 2
    assert (windows.video_from_crop[:, [0, 1], [1, 0]] == 0).all()
    corners = affine.apply(
        affine.invert(windows.video_from_crop), np.stack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], 1)
    )
    assert corners.min() > 0
    assert (corners < windows.size).all()


def test_small_characters_are_not_magnified_and_their_windows_lie_on_whole_pixels():
    boxes = boxes_at(np.stack([np.linspace(50, 90, 9), np.full(9, 60.3)], 1), np.tile([20.0, 40.0], (9, 1)))
    maps = windows_of(boxes, np.zeros(9, int), 0, CropSettings()).video_from_crop
    assert (maps[:, 0, 0] == 1.0).all()
    assert (maps[:, :, 2] == np.round(maps[:, :, 2])).all()


def test_poses_do_not_zoom_the_window_and_a_zoom_does():
    time = np.arange(80)
    poses = 0.12 * np.sin(time / 3.0)
    assert np.ptp(zoom_path(poses, np.zeros(80, int), 0)) == 0.0
    zoom = zoom_path(poses + np.log(2.0) * time / 79, np.zeros(80, int), 0)
    assert 1.3 < zoom[-1] / zoom[0] < 2.05
    assert (np.diff(zoom) >= -1e-9).all()


def test_a_character_in_place_has_a_still_window_and_a_cut_moves_it():
    sway = np.stack([300 + 5 * np.sin(np.arange(40)), 200 + 5 * np.cos(np.arange(40))], 1)
    boxes = boxes_at(sway, np.tile([100.0, 200.0], (40, 1)))
    boxes[20:, 0] += 250
    shot = np.repeat([0, 1], 20)
    maps = windows_of(boxes, shot, 3, CropSettings()).video_from_crop
    assert (maps[:20] == maps[0]).all()
    assert (maps[20:] == maps[20]).all()
    assert maps[20, 0, 2] - maps[0, 0, 2] > 200
