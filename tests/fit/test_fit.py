"""The fit on drawn figures of 150 pixels, from true poses that were disturbed by a few pixels and degrees."""

import dataclasses

import numpy as np
import pytest
import torch

from tests.scene_values import crops_of, true_poses, true_vertices
from tests.scenes import Camera, Scene, make_scene
from wildpuppet.fit.fit import fit, join
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.puppet.build import build
from wildpuppet.settings import FitSettings, PuppetSettings
from wildpuppet.types import Crops, Fit, Poses, Puppet

torch.set_num_threads(1)
SIZE = (184, 184)
PIXELS, DEGREES = 2.0, 5.0
"""Standard deviations of each part's place and turn at the start: the median vertex is then some 3 pixels off."""
UNMOVED = FitSettings(steps=0)
SUB_PIXEL = 0.4
"""Bound of the median error, pixels. The art is sampled at one canvas pixel, 0.77 crop pixels: half of that."""


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    scene: Scene
    puppet: Puppet
    crops: Crops
    corners: np.ndarray

    def true(self) -> np.ndarray:
        """Where the vertices are in the crops, (T, V, 2)."""
        return true_vertices(self.scene, self.puppet) - self.corners[:, None]

    def poses(self) -> Poses:
        """The true poses, crop pixels."""
        poses = true_poses(self.scene)
        maps = poses.crop_from_canvas.copy()
        maps[..., 2] -= self.corners[:, None]
        return dataclasses.replace(poses, crop_from_canvas=maps)

    def fitted(self, frames: slice, poses: Poses, settings: FitSettings | None = None) -> Fit:
        return fit(self.puppet, self.crops, poses, frames, settings or FitSettings(), Machine(workers=1))

    def errors(self, found: Fit) -> np.ndarray:
        """Median distance from the truth in each fitted frame, pixels."""
        return np.median(np.linalg.norm(found.vertices_crop - self.true()[found.frames], axis=-1), 1)


def drawn(kind, frames: int = 24, hold: int = 1, camera: Camera | None = None) -> Case:
    """A scene and windows around the figure that follow its box unevenly, by whole pixels."""
    scene = make_scene(kind, frames, (256, 192), hold=hold, camera=camera, height=0.8)
    whole, (height, width) = crops_of(scene), scene.frames.shape[1:3]
    middle = scene.boxes[:, :2] + scene.boxes[:, 2:] / 2 + np.random.default_rng(0).integers(-2, 3, (frames, 2))
    corners = np.clip(np.round(middle - np.array(SIZE) / 2), 0, (width - SIZE[0], height - SIZE[1])).astype(int)
    images = [whole.images[t, y : y + SIZE[1], x : x + SIZE[0]] for t, (x, y) in enumerate(corners)]
    windows = np.stack([affine.scale_and_shift(1.0, (float(x), float(y))) for x, y in corners])
    boxes = np.concatenate([scene.boxes[:, :2] - corners, scene.boxes[:, 2:]], 1)
    crops = dataclasses.replace(whole, size=SIZE, images=np.stack(images), video_from_crop=windows, box_crop=boxes)
    return Case(scene, build(scene.cutout, PuppetSettings(edge=0.1)), crops, corners.astype(float))


def disturbed(case: Case) -> Poses:
    """Every part moved and turned about its middle, each by itself."""
    poses, draw = case.poses(), np.random.default_rng(1)
    maps = poses.crop_from_canvas.copy()
    for frame in maps:
        for layer in range(len(frame)):
            rest = case.puppet.vertices[case.puppet.layer_of_vertex == layer].mean(0, keepdims=True)
            middle = affine.apply(frame[layer], rest)[0]
            turn = affine.similarity(np.array(1.0), np.array(np.radians(draw.normal(0, DEGREES))), np.zeros(2))
            turn[:, 2] = middle - turn[:, :2] @ middle + draw.normal(0, PIXELS, 2)
            frame[layer] = affine.compose(turn, frame[layer])
    return dataclasses.replace(poses, crop_from_canvas=maps)


def similarity_residual(shape: np.ndarray, other: np.ndarray) -> float:
    """How far the second shape is from any shifted, turned and scaled copy of the first, pixels."""
    first, second = (points.astype(float) @ np.array([1.0, 1.0j]) for points in (shape, other))
    system = np.stack([first, np.ones_like(first)], 1)
    solution = np.linalg.lstsq(system, second, rcond=None)[0]
    return float(np.abs(system @ solution - second).max())


@pytest.mark.parametrize("kind", ["walk", "zoom"])
def test_disturbed_poses_come_back_to_less_than_a_pixel(kind):
    case = drawn(kind)
    poses = disturbed(case)
    before = case.errors(case.fitted(slice(4, 6), poses, UNMOVED))
    found = case.fitted(slice(4, 6), poses)
    assert before.min() > 2.0
    assert case.errors(found).max() < SUB_PIXEL
    assert found.state == ("fitted",) * 2
    assert np.array_equal(found.frames, [4, 5])
    assert all(values.shape == (2,) and np.isfinite(values).all() for values in found.losses.values())


@pytest.mark.parametrize("camera", ["pan", "zoom"])
def test_a_held_drawing_keeps_its_shape_under_a_moving_camera(camera):
    case = drawn("walk", hold=3, camera=camera)
    found = case.fitted(slice(6, 9), disturbed(case))
    assert found.state == ("fitted", "held", "held")
    first = found.vertices_crop[0]
    for frame in (1, 2):
        assert similarity_residual(first, found.vertices_crop[frame]) < 1e-3  # single precision
    assert case.errors(found).max() < SUB_PIXEL  # a pan moves the figure by 12 pixels a frame


def test_a_held_drawing_stands_still_under_a_still_camera():
    case = drawn("walk", hold=3)
    found = case.fitted(slice(6, 10), disturbed(case))
    assert found.state == ("fitted", "held", "held", "fitted")
    in_video = found.vertices_crop + case.corners[6:10, None]
    np.testing.assert_allclose(in_video[1:3], np.broadcast_to(in_video[0], in_video[1:3].shape), atol=1e-4)
    assert np.abs(in_video[3] - in_video[0]).max() > 3.0
    assert case.errors(found).max() < SUB_PIXEL


@pytest.fixture(scope="module")
def short() -> Case:
    """Three drawings, two frames each; the layers change places."""
    return drawn("order", frames=6, hold=2)


def test_no_steps_give_the_poses_as_they_are(short):
    found = short.fitted(slice(2, 4), short.poses(), UNMOVED)
    np.testing.assert_allclose(found.vertices_crop, short.true()[2:4], atol=1e-3)


def test_join_puts_chunks_in_order(short):
    whole = short.fitted(slice(0, 6), short.poses(), UNMOVED)
    joined = join([short.fitted(part, short.poses(), UNMOVED) for part in (slice(0, 4), slice(4, 6))])
    np.testing.assert_array_equal(joined.frames, np.arange(6))
    np.testing.assert_allclose(joined.vertices_crop, whole.vertices_crop, atol=1e-4)
    np.testing.assert_array_equal(joined.order, short.scene.order)
    assert joined.state == ("fitted", "held") * 3
    assert joined.confidence.shape == whole.confidence.shape
    assert joined.losses.keys() == whole.losses.keys()
    assert all(len(values) == 6 for values in joined.losses.values())


def test_lost_frames_say_so(short):
    lost = dataclasses.replace(short.crops, state=("followed", "followed", "lost", "lost", "found", "bridged"))
    found = dataclasses.replace(short, crops=lost).fitted(slice(0, 6), short.poses(), UNMOVED)
    assert found.state == ("fitted", "held", "lost", "lost", "fitted", "held")


def test_progress_reaches_its_total(short):
    told: list[tuple[int, int]] = []
    machine = Machine(workers=1, progress=lambda done, total: told.append((done, total)))
    fit(short.puppet, short.crops, short.poses(), slice(0, 5), UNMOVED, machine)
    assert told[-1] == (5, 5)
    assert [done for done, _ in told] == sorted(done for done, _ in told)
