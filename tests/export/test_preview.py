from dataclasses import replace

import numpy as np
import pytest

from tests.correspond import scene
from wildpuppet.export.meshes import vertices_video
from wildpuppet.export.overlay import dimmed
from wildpuppet.export.preview import caption, preview_frames, typical_scale
from wildpuppet.geometry.affine import scale_and_shift

RENDERED_LEVELS = 2


@pytest.fixture(scope="module")
def world():
    character = scene.puppet()
    crops, fit = scene.posed(character, scene.motion(3))
    return character, crops, replace(fit, state=("fitted", "lost", "held"))


def sources(number, size=scene.CANVAS):
    return (np.full((size[1], size[0], 3), 90 + 10 * i, np.uint8) for i in range(number))


def test_left_is_the_wireframe_and_right_the_puppet(world):
    width, height = scene.CANVAS
    frames = list(preview_frames(sources(3), *world))
    assert {frame.shape for frame in frames} == {(height + 24, 2 * width, 3)}
    assert all(side % 2 == 0 for side in frames[0].shape[:2])
    left, right = frames[0][:height, :width], frames[0][:height, width:]
    x, y, w, h = scene.ARM
    arm = right[y + 2 : y + h - 2, x + 2 : x + w - 2].astype(int)
    assert np.abs(arm - [40, 90, 200]).max() <= RENDERED_LEVELS
    assert (right[:10] == dimmed(left)[:10]).all()
    assert (left[:10] == 90).all()  # nothing is drawn away from the puppet
    changed = (left != 90).any(-1)
    assert changed[y - 6 : y + h + 6, x - 6 : x + w + 6].mean() > 0.1
    assert not np.array_equal(frames[0][height:], frames[2][height:])  # captions differ


def test_a_lost_frame_shows_the_source_alone(world):
    width, height = scene.CANVAS
    lost = list(preview_frames(sources(3), *world))[1]
    assert (lost[:height, :width] == 100).all()
    assert len(np.unique(lost[:height, width:])) == 1


def test_wide_sources_shrink_and_odd_ones_become_even(world):
    character, crops, fit = world
    maps = np.stack([scene.scale_and_shift(16.0, (0, 0))] * 3)[:, None].repeat(2, 1)
    crops, fit = scene.posed(character, maps)
    frame = next(preview_frames(sources(1, (2561, 1921)), character, crops, fit))
    assert frame.shape == (720 + 24, 1920, 3)
    arm = frame[50 * 6 : 50 * 6 + 4, 960 + 110 * 6 : 960 + 110 * 6 + 4].astype(int)
    assert np.abs(arm - [40, 90, 200]).max() <= RENDERED_LEVELS


def test_too_few_sources_are_a_mistake(world):
    with pytest.raises(ValueError, match="expected 3 source frames, found 2"):
        list(preview_frames(sources(2), *world))


def test_scale_and_caption(world):
    character, crops, fit = world
    doubled = np.stack([scale_and_shift(2.0, (5, 5))] * 3)[:, None].repeat(2, 1)
    crops, fit = scene.posed(character, doubled)
    assert typical_scale(character, vertices_video(crops, fit), fit) == pytest.approx(2.0)
    assert caption(fit, 1) == "frame 101   fitted   confidence 1.00   total 1.5"
