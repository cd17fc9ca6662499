"""The search on drawn figures, at a coarse grid to be quick: 48 pixels along the figure, 24 angles.

Of the figure's size, a pixel of this grid is 2 %: rounding to it moves a part by 0.8 % on average. Rounding to 15
degrees moves the middle half of a limb by up to 0.6 % more, and sizes come in steps of 6 %. Bounds are about twice
that.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import cv2
import numba
import numpy as np
import pytest
import torch

from tests.scene_values import crops_of, true_vertices
from tests.scenes import Kind, Scene, make_scene
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.look import SIZE_STEP
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.search import SIZE_CHANGE, SIZE_PRIOR, expected_sizes, search, searcher_of, size_after
from wildpuppet.pose.stretch import MOST, STEP
from wildpuppet.pose.twins import MOST_TRADES
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings, SearchSettings
from wildpuppet.types import Crops, Hypotheses, Puppet

torch.set_num_threads(1)
COARSE = SearchSettings(box_pixels=48, angles=24)
BEST, ONE_OF_N = 0.03, 0.025
"""Bounds of the median vertex error, as shares of the figure's size."""


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Kernels on one thread: on busy processors, threads that wait for each other take many times as long."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


def drawn(kind: Kind, **choices: int) -> tuple[Scene, Puppet, Crops]:
    scene = make_scene(kind, size=(160, 120), height=0.8, **choices)
    return scene, build(scene.cutout, PuppetSettings(edge=0.1)), crops_of(scene)


def searched(scene: Scene, puppet: Puppet, crops: Crops, frames: Sequence[int], off: float = 1.0) -> Hypotheses:
    """Search from where the torso is in the first frame, its size wrong by the factor ``off``."""
    placement = affine.compose(
        affine.scale_and_shift(off, (0.0, 0.0)), scene.video_from_canvas[0, scene.layer("torso")]
    )
    return search(puppet, crops, placement, None, np.array(frames), COARSE, Machine(workers=1))


def errors(scene: Scene, puppet: Puppet, hypotheses: Hypotheses, frames: Sequence[int]) -> np.ndarray:
    """Median distance of the vertices from the truth, (T, N), as a share of the figure's size."""
    true = true_vertices(scene, puppet)[frames]
    distance = np.linalg.norm(pose_vertices(puppet, hypotheses.crop_from_canvas) - true[:, None], axis=-1)
    return np.median(distance, -1) / np.ptp(true, axis=1).max(-1)[:, None]


def sizes(maps: np.ndarray) -> np.ndarray:
    """Scale of most layers in each frame."""
    return np.median(np.sqrt(np.linalg.det(maps[..., :2])), axis=1)


@pytest.mark.parametrize(("kind", "frames"), [("walk", [0, 1, 2]), ("crossing", [6, 8])])
def test_poses_are_found(kind, frames):
    scene, puppet, crops = drawn(kind)
    found = searched(scene, puppet, crops, frames)
    wrong = errors(scene, puppet, found, frames)
    assert wrong[:, 0].max() < BEST
    assert wrong.min(1).max() < ONE_OF_N
    check_form(found, len(frames), puppet.num_layers)


def check_form(found: Hypotheses, num_frames: int, num_layers: int) -> None:
    """Best first; distinct poses; every order a permutation; one size, the best's parts whole steps longer than it."""
    assert found.cost.shape == (num_frames, COARSE.num_best + MOST_TRADES)
    finite = np.where(np.isfinite(found.cost), found.cost, 1e9)
    assert (np.diff(finite, axis=1) >= 0).all()
    assert (np.sort(found.order, -1) == np.arange(num_layers)).all()
    scale = np.sqrt(np.linalg.det(found.crop_from_canvas[..., :2]))
    np.testing.assert_allclose(scale[:, 1:], np.broadcast_to(scale[:, 1:2, :1], scale[:, 1:].shape))
    steps = 2 * np.log(scale[:, 0] / scale[:, 1, :1]) / np.log(STEP)
    np.testing.assert_allclose(steps, steps.round(), atol=1e-6)
    assert (np.abs(steps.round()) <= MOST).all()
    for maps, cost in zip(found.crop_from_canvas, found.cost, strict=True):
        kept = maps[np.isfinite(cost)]
        assert all(np.abs(a - b).max() > 0 for i, a in enumerate(kept) for b in kept[:i])


def test_a_zoom_is_followed():
    scene, puppet, crops = drawn("zoom")
    frames = list(range(0, 12, 2))  # the figure grows by 29 %
    found = searched(scene, puppet, crops, frames)
    assert errors(scene, puppet, found, frames)[:, 0].max() < BEST
    true = sizes(scene.video_from_canvas[frames])
    assert true[-1] / true[0] > 1.25
    ratio = sizes(found.crop_from_canvas[:, 0]) / true
    assert (np.abs(np.log(ratio)) < np.log(1.13)).all()  # two steps: one to see the growth, one of rounding
    assert size_after(found) == pytest.approx(sizes(found.crop_from_canvas[:, 0])[-1])


def test_a_wrong_first_size_is_mended():
    scene, puppet, crops = drawn("walk")
    found = searched(scene, puppet, crops, [0, 1, 2, 3], off=0.83)
    wrong = errors(scene, puppet, found, [0, 1, 2, 3])[:, 0]
    true = sizes(scene.video_from_canvas[:4])
    assert abs(np.log(sizes(found.crop_from_canvas[:, 0]) / true)[-1]) < np.log(1.09)
    assert wrong[-1] < BEST


def test_frames_of_one_drawing_repeat_its_poses():
    scene, puppet, crops = drawn("twos", frames=4)
    windows = np.array([[[1.0, 0, x], [0, 1.0, 0]] for x in (0.0, 7.0, -5.0, 0.0)])  # the window goes with the drawing
    found = searched(scene, puppet, dataclasses.replace(crops, video_from_crop=windows), [0, 1, 2])
    np.testing.assert_array_equal(found.crop_from_canvas[1], found.crop_from_canvas[0])
    np.testing.assert_array_equal(found.cost[1], found.cost[0])
    np.testing.assert_array_equal(found.order[1], found.order[0])
    assert np.abs(found.crop_from_canvas[2] - found.crop_from_canvas[1]).max() > 1.0


def test_same_again():
    scene, puppet, crops = drawn("crossing", frames=2)
    first, second = (searched(scene, puppet, crops, [0]) for _ in range(2))
    np.testing.assert_array_equal(first.crop_from_canvas, second.crop_from_canvas)
    np.testing.assert_array_equal(first.cost, second.cost)


def test_a_coarse_search_that_would_see_too_little_is_left_out():
    scene, puppet, crops = drawn("crossing", frames=2)
    placement = scene.video_from_canvas[0, scene.layer("torso")]
    found = [
        search(puppet, crops, placement, None, np.array([0]), settings, Machine(workers=1))
        for settings in (
            SearchSettings(box_pixels=32, angles=12, coarse=0.0),
            SearchSettings(box_pixels=32, angles=12, coarse=0.7),
        )
    ]
    np.testing.assert_array_equal(found[0].crop_from_canvas, found[1].crop_from_canvas)


def in_growing_windows(scene: Scene, ratio: float) -> tuple[Crops, np.ndarray]:
    """Cut the scene's frames anew in windows that grow to ``ratio`` times their size; returns that factor per frame."""
    crops = crops_of(scene)
    grown = ratio ** np.linspace(0.0, 1.0, len(crops.frames))
    video_from_crop = np.stack([affine.scale_and_shift(float(factor), (0.0, 0.0)) for factor in grown])
    images = np.stack([
        cv2.warpAffine(image, affine.for_opencv(affine.invert(to_video)), crops.size, flags=cv2.INTER_LINEAR)
        for image, to_video in zip(crops.images[:], video_from_crop, strict=True)
    ])  # fmt: skip
    boxes = crops.box_crop / grown[:, None]
    return dataclasses.replace(crops, images=images, video_from_crop=video_from_crop, box_crop=boxes), grown


def test_a_size_kept_in_the_video_is_expected():
    """Closed form: a window 1.25 times as large shows the character 1.25 times smaller."""
    scene, puppet, _ = drawn("walk")
    crops, scale = in_growing_windows(scene, 1.25)
    placement = affine.scale_and_shift(1.0, (0.0, 0.0))
    searcher = searcher_of(puppet, placement, COARSE)
    expected = expected_sizes(searcher, crops, placement)
    first = searcher.exact_step(1.0)
    np.testing.assert_allclose(expected.kept, first - np.log(scale) / np.log(SIZE_STEP))
    diagonal = np.hypot(crops.box_crop[:, 2], crops.box_crop[:, 3])
    np.testing.assert_allclose(expected.boxed, first + np.log(diagonal / diagonal[0]) / np.log(SIZE_STEP))
    for at in (expected.kept, expected.boxed):
        assert expected.price(3, at[3:4])[0] == pytest.approx(0.0)
    midway = (expected.kept[-1] + expected.boxed[-1]) / 2
    off = abs(expected.kept[-1] - midway)
    assert expected.price(len(scale) - 1, np.array([midway]))[0] == pytest.approx(SIZE_PRIOR * off**2)


def test_the_size_that_was_found_is_expected_from_there_on():
    scene, puppet, _ = drawn("walk")
    crops, _ = in_growing_windows(scene, 1.25)
    placement = affine.scale_and_shift(1.0, (0.0, 0.0))
    expected = expected_sizes(searcher_of(puppet, placement, COARSE), crops, placement)
    found = expected.found(2, expected.kept[2] - 2.0)
    np.testing.assert_allclose(found.kept, expected.kept - 2.0)
    np.testing.assert_allclose(np.diff(found.boxed), np.diff(expected.boxed))
    assert found.boxed[2] == pytest.approx(found.kept[2])
    assert found.price(2, found.kept[2] + np.array([-1.0, 0.0, 2.0])) == pytest.approx(
        [SIZE_CHANGE, 0.0, 2 * SIZE_CHANGE]
    )


def test_a_box_that_grows_is_not_a_character_that_grows():
    scene, puppet, _ = drawn("walk")
    crops, grown = in_growing_windows(scene, 1.25)
    crops = dataclasses.replace(crops, box_crop=crops.box_crop * 1.6 ** np.linspace(0, 1, len(grown))[:, None])
    frames = list(range(0, len(grown), 4))
    found = searched(scene, puppet, crops, frames)
    true = sizes(scene.video_from_canvas[frames]) / grown[frames]
    assert true[-1] / true[0] < 0.9
    assert (np.abs(np.log(sizes(found.crop_from_canvas[:, 0]) / true)) < np.log(1.09)).all()


def test_frames_without_the_character_leave_its_size_alone():
    scene, puppet, crops = drawn("walk")
    images, lost, frames = crops.images[:].copy(), [1, 2, 3], [0, 1, 2, 3, 4]
    images[lost] = (120, 130, 110, 0)
    state = tuple("lost" if t in lost else "followed" for t in range(len(images)))
    found = searched(scene, puppet, dataclasses.replace(crops, images=images, state=state), frames)
    own = sizes(found.crop_from_canvas[:, 0])
    np.testing.assert_allclose(own[lost], own[0])
    assert abs(np.log(own[4] / sizes(scene.video_from_canvas[:5])[4])) < np.log(1.09)
    assert errors(scene, puppet, found, frames)[4, 0] < BEST


def test_another_shot_is_expected_as_large_as_its_box():
    _, puppet, crops = drawn("cut")
    searcher = searcher_of(puppet, affine.scale_and_shift(1.0, (0.0, 0.0)), COARSE)
    expected = expected_sizes(searcher, crops, affine.scale_and_shift(1.0, (0.0, 0.0)))
    first = int(np.flatnonzero(crops.shot == crops.shot[-1])[0])
    assert first > 0
    assert abs(expected.boxed[first] - expected.boxed[first - 1]) > 1
    np.testing.assert_allclose(expected.kept[first:], expected.boxed[first])
    state = tuple("lost" if t == first else "followed" for t in range(len(crops.frames)))
    later = expected_sizes(searcher, dataclasses.replace(crops, state=state), affine.scale_and_shift(1.0, (0.0, 0.0)))
    np.testing.assert_allclose(later.kept[first:], expected.boxed[first + 1])
