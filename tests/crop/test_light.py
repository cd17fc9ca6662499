from pathlib import Path

import numpy as np
import pytest

from tests.scenes import write_clip
from tests.scenes.scene import Scene
from tests.scenes.stress import film, shares, strides
from wildpuppet.crop.cut import cut
from wildpuppet.crop.light import LEAST_CHANGE, in_one_light, light_between, without_light
from wildpuppet.crop.warp import cut_window
from wildpuppet.machine import Machine
from wildpuppet.settings import CropSettings, ProbeSettings
from wildpuppet.track.plate import median_plate
from wildpuppet.track.survey import Survey
from wildpuppet.types import Target, Track
from wildpuppet.video.probe import probe

FRAMES, SIZE = 12, (160, 120)


def world(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(40, 160, (40, 60, 3)).astype(np.uint8)


def survey_of(pictures: list[np.ndarray]) -> Survey:
    still = np.tile(np.array([[1.0, 0, 0], [0, 1.0, 0]]), (len(pictures), 1, 1))
    plate = median_plate(pictures, [everywhere(0)] * len(pictures), still)
    return Survey(still, np.zeros(len(pictures), int), {0: plate}, {0: dict(enumerate(pictures))})


def everywhere(_: int) -> np.ndarray:
    return np.full((40, 60), 255, np.uint8)


def test_light_is_measured_by_channel_and_taken_away_though_a_third_is_covered():
    gain = np.array([1.3, 0.8, 0.5])
    picture = np.clip(np.rint(world() * gain), 0, 255).astype(np.uint8)
    picture[:13] = 250
    assert light_between(picture, world(), np.ones((40, 60), bool)) == pytest.approx(gain, rel=0.02)
    assert light_between(picture, world(), np.zeros((40, 60), bool)).tolist() == [1.0, 1.0, 1.0]
    back = without_light(picture, gain)[13:].astype(int)
    assert np.abs(back - world()[13:]).max() <= 1


def test_shots_in_steady_light_stay_as_they_are_and_others_come_to_one_light():
    steady = survey_of([world()] * 5)
    same, changing = in_one_light(steady, everywhere)
    assert not changing
    assert same.plates[0] is steady.plates[0]
    gains = 1.0 + np.linspace(-2 * LEAST_CHANGE, 2 * LEAST_CHANGE, 5)
    dimmed = survey_of([np.rint(world() * gain).astype(np.uint8) for gain in gains])
    one, changing = in_one_light(dimmed, everywhere)
    assert changing == {0}
    assert one.plates[0].spread.max() <= 1
    assert np.abs(one.plates[0].colour.astype(int) - world()).max() <= 2


def walk_at_dusk(dusk: float) -> Scene:
    light = 1.0 + shares(FRAMES)[:, None, None] * (np.full((2, 3), dusk) - 1.0)
    return film(strides(FRAMES), SIZE, 3, x=0.25 + 0.5 * shares(FRAMES), light=light).draw()


def overlaps(dusk: float, path: Path) -> np.ndarray:
    """Intersection over union of the matte and the true coverage, frame by frame."""
    scene = walk_at_dusk(dusk)
    clip = probe(write_clip(scene, path), ProbeSettings(), Machine())
    track = Track(np.arange(FRAMES), scene.boxes, ("followed",) * FRAMES, np.ones(FRAMES), np.zeros(FRAMES, int))
    crops = cut(clip, track, Target(tuple(scene.boxes[4]), 4, 0, FRAMES), CropSettings(box_pixels=96), Machine())
    alpha = np.repeat(scene.alpha[..., None], 3, -1)
    shares = []
    for t, image in enumerate(crops.images[:]):
        true = cut_window(alpha[t], crops.video_from_crop[t], crops.size)[..., 0] > 128
        found = image[..., 3] > 128
        shares.append((true & found).sum() / (true | found).sum())
    return np.array(shares)


def test_the_matte_stays_on_the_character_when_the_light_changes(tmp_path: Path) -> None:
    by_day, at_dusk = overlaps(1.0, tmp_path / "day.mp4"), overlaps(0.55, tmp_path / "dusk.mp4")
    assert by_day.min() > 0.75
    assert (at_dusk - by_day).min() > -0.03
