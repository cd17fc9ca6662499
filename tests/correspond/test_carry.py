from dataclasses import replace

import numpy as np
import pytest

from tests.correspond import scene
from wildpuppet.correspond.carry import carry
from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import apply, similarity

CLOSED_FORM_PIXELS = 1e-3


@pytest.fixture
def character():
    return scene.puppet()


def test_points_follow_the_closed_form_from_any_frame(character):
    maps = scene.motion(6)
    crops, fit = scene.posed(character, maps)
    rng = np.random.default_rng(0)
    canvas = np.concatenate([rng.uniform((42, 32), (84, 78), (20, 2)), rng.uniform((91, 41), (139, 59), (20, 2))])
    layer = np.repeat([0, 1], 20)
    parts = [character.names[k] for k in layer]
    truth = np.stack([[apply(m[k], p[None])[0] for k, p in zip(layer, canvas, strict=True)] for m in maps])
    for start in (0, 4):
        tracks = carry(character, crops, fit, truth[start], 100 + start, parts)
        assert np.abs(tracks.points_video - truth).max() < CLOSED_FORM_PIXELS
    assert (tracks.frames == np.arange(100, 106)).all()


def test_a_point_belongs_to_the_frontmost_ink(character):
    maps = scene.motion(2)
    crops, fit = scene.posed(character, maps)
    over_both, body_only = (95.0, 50.0), (60.0, 50.0)
    under_arm_margin = (88.0, 50.0)  # inside the arm's mesh, left of its ink: the body shows
    right_of_arm = (146.0, 50.0)  # 6 px right of the arm's ink, beyond its mesh
    by_the_body = (70.0, 81.0)  # 1 px under the body's ink, inside its mesh
    points = np.array([over_both, body_only, under_arm_margin, right_of_arm, by_the_body])
    moved = carry(character, crops, fit, points, 100).points_video[1]
    expected = [apply(maps[1, layer], points[n : n + 1])[0] for n, layer in enumerate((1, 0, 0, 1, 0))]
    assert np.abs(moved - expected).max() < CLOSED_FORM_PIXELS
    behind = carry(character, crops, replace(fit, order=fit.order[:, ::-1]), points[:1], 100).points_video[1]
    assert np.abs(behind - apply(maps[1, 0], points[:1])).max() < CLOSED_FORM_PIXELS


def test_margin_of_two_parts_goes_to_the_nearer_drawing():
    left, right = (10, 10, 20, 20), (36, 10, 20, 20)  # 6 px apart: both margins reach the gap's middle
    character = scene.puppet((left, right), ("left", "right"))
    still, moved = np.eye(2, 3), np.array([[1.0, 0.0, 7.0], [0.0, 1.0, 0.0]])
    crops, fit = scene.posed(character, np.stack([np.stack([still, still]), np.stack([still, moved])]))
    tracks = carry(character, crops, fit, np.array([[32.0, 20.0], [34.0, 20.0]]), 100)
    assert np.allclose(tracks.points_video[1], [[32.0, 20.0], [41.0, 20.0]], atol=CLOSED_FORM_PIXELS)


def test_visibility_flips_where_a_layer_moves_over():
    """A bar of ink 20 px wide slides right one pixel a frame; x = 60.5 is under its ink in frames 41 to 60."""
    character = scene.puppet(((20, 20, 80, 40), (0, 10, 20, 60)), ("body", "bar"))
    t = np.arange(80.0)
    slide = similarity(np.ones(80), np.zeros(80), np.stack([t, 0 * t], -1))
    crops, fit = scene.posed(character, np.stack([np.tile(np.eye(2, 3), (80, 1, 1)), slide], 1))
    tracks = carry(character, crops, fit, np.array([[60.5, 40.0]]), 100, ["body"])
    assert np.flatnonzero(~tracks.visible[:, 0]).tolist() == list(range(41, 61))
    assert (tracks.confidence == 1).all()  # the vertices say it, and know what is hidden
    in_front = replace(fit, order=np.where((t < 50)[:, None], [0, 1], [1, 0]))
    flipped = carry(character, crops, in_front, np.array([[60.5, 40.0]]), 100, ["body"])
    assert np.flatnonzero(~flipped.visible[:, 0]).tolist() == list(range(41, 50))


def test_named_part_is_taken_though_hidden(character):
    maps = scene.motion(3)
    crops, fit = scene.posed(character, maps)
    point = np.array([[95.0, 50.0]])
    tracks = carry(character, crops, fit, point, 100, ["body"])
    assert np.abs(tracks.points_video[2] - apply(maps[2, 0], point)).max() < CLOSED_FORM_PIXELS
    assert not tracks.visible[0, 0]


def test_lost_frames_and_the_video_border_hide_points(character):
    crops, fit = scene.posed(character, scene.motion(4))
    fit = replace(fit, state=("fitted", "fitted", "lost", "fitted"))
    tracks = carry(character, crops, fit, np.array([[60.0, 50.0], [135.0, 50.0]]), 100, size=(130, 120))
    assert tracks.visible[:, 0].tolist() == [True, True, False, True]
    assert not tracks.visible[:, 1].any()
    assert (tracks.confidence[2] == 0).all()


def test_confidence_mixes_vertices_and_falls_beside_the_mesh(character):
    crops, fit = scene.posed(character, scene.motion(2))
    rising = character.vertices[:, 0] / 200.0
    fit = replace(fit, confidence=np.stack([rising, rising]))
    inside, beside = np.array([[60.0, 50.0]]), np.array([[160.0, 50.0]])
    assert np.allclose(carry(character, crops, fit, inside, 100).confidence, 0.3)
    assert (carry(character, crops, fit, beside, 100).confidence < 0.6 * rising.max()).all()


def test_mistakes_are_named(character):
    crops, fit = scene.posed(character, scene.motion(2))
    with pytest.raises(InputError, match=r"100 to 101.*found 7"):
        carry(character, crops, fit, np.zeros((1, 2)), 7)
    with pytest.raises(InputError, match=r"point 2.*body, arm.*'leg'"):
        carry(character, crops, fit, np.zeros((2, 2)), 100, ["arm", "leg"])
    with pytest.raises(ValueError, match="one part per point"):
        carry(character, crops, fit, np.zeros((2, 2)), 100, ["arm"])
