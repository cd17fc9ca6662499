"""Inverse kinematics against the scene's own forward kinematics."""

import numpy as np

from tests.scenes import make_scene
from wildpuppet.geometry import affine
from wildpuppet.pose.reach import reach, similarities
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings

HAND = np.array([[154.0, 158.0]])


def test_a_hand_pulls_its_arm_along_and_nothing_else() -> None:
    scene = make_scene("walk", frames=9, size=(160, 120), seed=1)
    puppet = build(scene.cutout, PuppetSettings(edge=0.25))
    forearm, upper, torso = (scene.layer(name) for name in ("left_forearm", "left_upper_arm", "torso"))
    before, after = scene.video_from_canvas[0], scene.video_from_canvas[2]
    wanted = affine.apply(before[torso], affine.apply(affine.invert(after[torso]), scene.truth(HAND, forearm)[2]))
    found = reach(puppet, before, np.array([forearm]), HAND, wanted)
    assert np.abs(affine.apply(found[forearm], HAND) - wanted).max() < 0.2
    others = [layer for layer in range(10) if layer not in (forearm, upper)]
    middle = np.array([[100.0, 110.0]])
    assert np.abs(affine.apply(found[others], middle[None]) - affine.apply(before[others], middle[None])).max() < 1.0
    hinges = (puppet.vertices[puppet.joint_vertices] * puppet.joint_weights[..., None]).sum(-2)
    sides = affine.apply(found[puppet.joint_layers], hinges[:, :, None])[:, :, 0]
    assert np.linalg.norm(sides[:, 0] - sides[:, 1], axis=1).max() < 1.0
    np.testing.assert_allclose(np.linalg.det(found[..., :2]), np.linalg.det(before[..., :2]), rtol=1e-6)


def test_similarities_of_posed_vertices_are_the_maps_that_posed_them() -> None:
    scene = make_scene("walk", frames=3, size=(160, 120), seed=1)
    puppet = build(scene.cutout, PuppetSettings(edge=0.25))
    maps = scene.video_from_canvas[:, puppet.layer_of_vertex]
    vertices = (maps[..., :2] @ puppet.vertices[:, :, None])[..., 0] + maps[..., 2]
    np.testing.assert_allclose(similarities(puppet, vertices), scene.video_from_canvas, atol=1e-4)
