import numpy as np

from tests.scenes import make_scene
from wildpuppet.geometry import affine
from wildpuppet.pose.similarity import placed, similarities
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings


def test_similarities_of_posed_vertices_are_the_maps_that_posed_them() -> None:
    scene = make_scene("walk", frames=3, size=(160, 120), seed=1)
    puppet = build(scene.cutout, PuppetSettings(edge=0.25))
    maps = scene.video_from_canvas[:, puppet.layer_of_vertex]
    vertices = (maps[..., :2] @ puppet.vertices[:, :, None])[..., 0] + maps[..., 2]
    np.testing.assert_allclose(similarities(puppet, vertices), scene.video_from_canvas, atol=1e-4)


def test_one_point_shifts_a_part_and_two_turn_it_too() -> None:
    maps = np.stack([affine.scale_and_shift(0.5, (3.0, float(layer))) for layer in range(3)])
    turned = affine.similarity(np.array(0.5), np.array(2.5), np.array([7.0, -4.0]))
    points = np.array([[10.0, 20.0], [40.0, 25.0], [12.0, 6.0]])
    given = np.concatenate([affine.apply(turned, points[:2]), [[30.0, 31.0]]])
    found = placed(maps, np.array([2, 2, 0]), points, given)
    np.testing.assert_allclose(found[2], turned, atol=1e-9)
    np.testing.assert_array_equal(found[0, :, :2], maps[0, :, :2])
    np.testing.assert_allclose(affine.apply(found[0], points[2:]), given[2:], atol=1e-9)
    np.testing.assert_array_equal(found[1], maps[1])


def test_points_further_apart_than_their_part_is_long_are_met_halfway() -> None:
    found = placed(
        affine.scale_and_shift(1.0, (0.0, 0.0))[None],
        np.zeros(2, int),
        np.array([[0.0, 0.0], [10.0, 0.0]]),
        np.array([[50.0, 0.0], [50.0, 14.0]]),
    )
    np.testing.assert_allclose(affine.apply(found[0], np.array([[0.0, 0], [10, 0]])), [[50, 2], [50, 12]], atol=1e-9)
