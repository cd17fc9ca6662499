import numpy as np
import pytest

from tests.scenes import make_scene, write_clip
from wildpuppet.crop.cut import cut
from wildpuppet.crop.hold import Step, Steps, character_motion, go_along
from wildpuppet.crop.window import Windows
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.settings import CropSettings, ProbeSettings
from wildpuppet.types import Target, Track
from wildpuppet.video.probe import probe

STILL = affine.scale_and_shift(1.0, (0.0, 0.0))
BOX = np.array([50.0, 40.0, 60.0, 90.0])


def points(count: int = 100) -> np.ndarray:
    return np.random.default_rng(0).uniform(BOX[:2], BOX[:2] + BOX[2:], (count, 2))


def zoomed(scale: float, shift: tuple[float, float]) -> np.ndarray:
    """Zoom about the box's middle."""
    middle = BOX[:2] + BOX[2:] / 2
    return affine.scale_and_shift(scale, tuple(middle - scale * middle + np.array(shift)))


def test_a_drawing_that_moves_as_a_whole_is_found_among_background_and_errors():
    before = points()
    true = zoomed(1.01, (4.0, -1.5))
    after = affine.apply(true, before) + np.random.default_rng(1).normal(0, 0.1, before.shape)
    after[:20] = before[:20] + 1.0  # background that shows in the box
    after[20:35] += np.random.default_rng(2).normal(0, 6, (15, 2))
    motion = character_motion(Step(before, after, BOX), affine.scale_and_shift(1.0, (1.0, 1.0)))
    corners = np.stack([BOX[:2], BOX[:2] + BOX[2:]])
    assert np.abs(affine.apply(motion, corners) - affine.apply(true, corners)).max() < 0.15


def test_a_new_drawing_has_no_motion_and_a_still_one_none_at_all():
    before = points()
    scattered = before + np.random.default_rng(3).normal(0, 5, before.shape)
    assert character_motion(Step(before, scattered, BOX), STILL) is None
    noise = np.random.default_rng(4).normal(0, 0.05, before.shape)
    assert np.array_equal(character_motion(Step(before, before + noise, BOX), STILL), STILL)
    assert character_motion(Step(before[:4], before[:4], BOX), STILL) is None


def test_windows_go_along_but_not_away():
    planned = Windows((100, 100), np.repeat(affine.scale_and_shift(1.0, (10.0, 10.0))[None], 4, 0))
    steps = Steps(np.zeros(4, int))
    before = points()
    steps.steps = {t: Step(before, before + np.array([shift, 0.0]), BOX) for t, shift in ((1, 4.0), (2, 6.0), (3, 6.0))}
    maps = go_along(planned, steps, np.repeat(STILL[None], 4, 0), 1.0).video_from_crop
    assert maps[:, 0, 2] == pytest.approx([10.0, 14.0, 20.0, 10.0], abs=1e-6)  # 26 would be 16 % of 100 away


def test_twos_under_a_pan_are_recognised_and_stand_exactly_still_in_their_crops(tmp_path):
    scene = make_scene("twos", 16, seed=3, camera="pan")
    clip = probe(write_clip(scene, tmp_path / "clip.mp4"), ProbeSettings(), Machine())
    track = Track(np.arange(16), scene.boxes, ("followed",) * 16, np.ones(16), np.zeros(16, int))
    crops = cut(clip, track, Target(tuple(scene.boxes[2]), 2, 0, 16), CropSettings(), Machine())
    assert crops.drawing.tolist() == scene.drawing.tolist()
    torso = scene.layer("torso")
    places = affine.apply(affine.invert(crops.video_from_crop), scene.truth(scene.points_of(torso), torso))
    held = np.flatnonzero(np.diff(crops.drawing) == 0)
    assert np.abs(places[held + 1] - places[held]).max() < 0.2
