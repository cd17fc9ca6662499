"""A clip's fits of which some are wrong: what the network reads in those frames is what the others say."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.scene_values import crops_of, true_poses, true_vertices
from tests.scenes import make_scene
from wildpuppet.deform.distil import as_poses, distil
from wildpuppet.machine import Machine
from wildpuppet.pose.place import pose_vertices
from wildpuppet.puppet.build import build
from wildpuppet.settings import DistilSettings, PuppetSettings
from wildpuppet.types import Fit

WRONG = [5, 14]
FRAMES = 20
LEGS = ("left_thigh", "left_shin", "right_thigh", "right_shin")


@pytest.fixture(scope="module")
def material():
    """A walk, truly posed, but for two frames in which both legs stand where they stood five frames before."""
    torch.set_num_threads(1)
    scene = make_scene("walk", frames=FRAMES, size=(96, 80), seed=2)
    puppet, crops, poses = build(scene.cutout, PuppetSettings(edge=0.25)), crops_of(scene), true_poses(scene)
    truth = true_vertices(scene, puppet).astype(np.float32)
    legs = np.isin(
        puppet.layer_of_vertex, [i for i, name in enumerate(puppet.names) if "thigh" in name or "shin" in name]
    )
    assert legs.any()
    vertices = truth.copy()
    for frame in WRONG:
        vertices[frame, legs] = truth[frame - 5, legs]
    confidence = np.ones(vertices.shape[:2], np.float32)
    states = tuple("doubtful" if frame in WRONG else "fitted" for frame in range(FRAMES))
    return puppet, crops, poses, Fit(np.arange(FRAMES), vertices, scene.order, confidence, states), truth, legs


def test_what_is_read_in_frames_with_a_wrong_fit_is_nearer_to_the_truth(material):
    puppet, crops, poses, fit, truth, legs = material
    steps = []
    machine = Machine("cpu", progress=lambda done, total: steps.append((done, total)))
    read = distil(puppet, crops, poses, fit, DistilSettings(iterations=150), machine)
    found = pose_vertices(puppet, read.crop_from_canvas)
    off = np.linalg.norm(found - truth, axis=-1)[WRONG][:, legs].mean()
    was_off = np.linalg.norm(fit.vertices_crop - truth, axis=-1)[WRONG][:, legs].mean()
    assert off < 0.5 * was_off
    assert [done for done, _ in steps] == sorted(done for done, _ in steps)
    assert steps[-1][0] == steps[-1][1]
    np.testing.assert_array_equal(read.order, poses.order)


def test_nothing_changes_where_there_is_too_little_to_learn_from(material):
    puppet, crops, poses, fit, _, _ = material
    few = replace(fit, state=("fitted", "fitted") + ("lost",) * (FRAMES - 2))
    assert distil(puppet, crops, poses, few, DistilSettings(iterations=5), Machine("cpu")) is poses


def test_poses_of_rigidly_moved_vertices_give_them_back(material):
    puppet, _, poses, _, _, _ = material
    vertices = pose_vertices(puppet, poses.crop_from_canvas)
    np.testing.assert_allclose(pose_vertices(puppet, as_poses(puppet, vertices)), vertices, atol=1e-3)
