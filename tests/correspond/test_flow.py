from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.correspond import scene
from wildpuppet.correspond.flow import flow, write_flow
from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import apply, similarity

FLOAT32_PIXELS = 1e-3


@pytest.fixture(scope="module")
def world():
    character = scene.puppet()
    maps = scene.motion(5)
    return character, maps, *scene.posed(character, maps)


def ink(layer):
    """Pixels of the canvas on a part's ink, as drawn by hand at rest."""
    x, y, w, h = (scene.BODY, scene.ARM)[layer]
    mask = np.zeros((scene.CANVAS[1], scene.CANVAS[0]), bool)
    mask[y : y + h, x : x + w] = True
    return mask


def test_flow_is_the_known_motion_of_what_is_seen(world):
    character, maps, crops, fit = world
    dense = flow(character, crops, fit, 100, 103, scene.CANVAS)
    arm, body = ink(1), ink(0) & ~ink(1)
    assert (np.isfinite(dense.flow[..., 0]) == (arm | body)).all()
    for layer, mask in enumerate((body, arm)):
        rows, columns = np.nonzero(mask)
        centres = np.stack([columns, rows], 1) + 0.5
        assert np.abs(dense.flow[mask] - (apply(maps[3, layer], centres) - centres)).max() < FLOAT32_PIXELS


def test_visible_where_nothing_comes_over_it():
    """The body turns and leaves the picture on the left while the arm comes over it."""
    still = np.tile(np.eye(2, 3), (2, 1, 1))
    radians = np.array([0.3, -0.2])
    maps = np.stack([still, similarity(np.ones(2), radians, np.array([[-20.0, -15.0], [-60.0, 15.0]]))])
    character = scene.puppet()
    dense = flow(character, *scene.posed(character, maps), 100, 101, scene.CANVAS)
    body = ink(0) & ~ink(1)
    places = apply(maps[1, 0], np.argwhere(body)[:, ::-1] + 0.5)
    inside = ((places >= 0) & (places < scene.CANVAS)).all(1)
    x, y, w, h = scene.ARM
    arm = apply(maps[1, 1], np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]], float)).astype(np.float32)
    depth = np.array([cv2.pointPolygonTest(arm, place, True) for place in places.tolist()])
    sure = np.abs(depth) > 0.5  # half a texel: ink ends in a ramp of one texel
    assert (dense.visible[body] == (inside & (depth < 0)))[sure].all()
    assert 0.2 < dense.visible[body].mean() < 0.9
    assert not dense.visible[~(ink(0) | ink(1))].any()


def test_lost_frames_have_no_flow(world, tmp_path):
    character, _, crops, fit = world
    lost = replace(fit, state=("fitted", "lost", "fitted", "fitted", "fitted"))
    for source, target in ((100, 101), (101, 100)):
        assert np.isnan(flow(character, crops, lost, source, target, scene.CANVAS).flow).all()
    with pytest.raises(InputError):
        flow(character, crops, fit, 100, 105, scene.CANVAS)


def test_files_read_back(world, tmp_path):
    character, _, crops, fit = world
    dense = flow(character, crops, fit, 100, 103, scene.CANVAS)
    write_flow(tmp_path / "flow.flo", dense)
    middlebury = cv2.readOpticalFlow(str(tmp_path / "flow.flo"))
    known = np.isfinite(dense.flow)
    assert (middlebury[known] == dense.flow[known]).all()
    assert (middlebury[~known] > 1e9).all()
    write_flow(tmp_path / "flow.npz", dense)
    with np.load(tmp_path / "flow.npz") as stored:
        assert np.array_equal(stored["flow"], dense.flow, equal_nan=True)
        assert (stored["visible"] == dense.visible).all()
    with pytest.raises(InputError, match=r"\.npz or \.flo"):
        write_flow(tmp_path / "flow.exr", dense)
