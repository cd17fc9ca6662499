"""A leg that is drawn longer than the puppet's: the search lengthens the shin, and the foot is where it is drawn."""

import numpy as np
import pytest

from tests.pose.boxes import COLOURS, box_puppet, crops_around
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.look import look_at
from wildpuppet.pose.pieces import pieces_of
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.search import search, searcher_of
from wildpuppet.pose.stretch import MOST, STEP, look_with, shape_of
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops

SIZE = (80, 110)
BODY, SHIN, FOOT = (20, 8, 30, 34), (31, 40, 8, 26), (31, 64, 24, 8)
KNEE, ANKLE = (35.0, 42.0), (35.0, 66.0)
LEG = box_puppet([BODY, SHIN, FOOT], [(0, 1, KNEE), (1, 2, ANKLE)], SIZE)
SETTINGS = SearchSettings(box_pixels=64, angles=24, coarse=0.0)
STILL = affine.scale_and_shift(1.0, (0.0, 0.0))


def true_maps(length: float) -> np.ndarray:
    """The shin ``length`` times as long from the knee down, the foot with it, the body as it is."""
    longer, shift = np.diag([1.0, length]), (length - 1) * (ANKLE[1] - KNEE[1])
    shin = np.concatenate([longer, (np.array(KNEE) - longer @ KNEE)[:, None]], 1)
    return np.stack([STILL, shin, affine.scale_and_shift(1.0, (0.0, shift))])


def drawn(length: float) -> Crops:
    crops = crops_around(1, SIZE, box=(20, 8, 35, 90), ordered=False)
    for layer, (box, maps) in enumerate(zip((BODY, SHIN, FOOT), true_maps(length), strict=True)):
        x, y, w, h = box
        low, high = affine.apply(maps, np.array([[x, y], [x + w, y + h]], float)).round().astype(int)
        crops.images[0, low[1] : high[1], low[0] : high[0]] = (*COLOURS[layer], 255)
    return crops


def found(crops: Crops, settings: SearchSettings = SETTINGS) -> np.ndarray:
    return search(LEG, crops, STILL, None, np.array([0]), settings, Machine(workers=1)).crop_from_canvas[0, 0]


def lengths(maps: np.ndarray) -> np.ndarray:
    """How many times as long as wide each part has become."""
    values = np.linalg.svd(maps[:, :, :2], compute_uv=False)
    return np.asarray(values[:, 0] / values[:, 1])


def errors(maps: np.ndarray, length: float) -> np.ndarray:
    """Largest distance of each part's corners from the truth, pixels."""
    apart = np.linalg.norm(pose_vertices(LEG, maps) - pose_vertices(LEG, true_maps(length)), axis=1)
    return np.array([apart[LEG.layer_of_vertex == layer].max() for layer in range(LEG.num_layers)])


@pytest.mark.parametrize("length", [1 / STEP, STEP, STEP**2])
def test_part_becomes_as_long_as_it_is_drawn(length):
    crops = drawn(length)
    maps = found(crops)
    np.testing.assert_allclose(lengths(maps), [1.0, max(length, 1 / length), 1.0], rtol=1e-6)
    assert errors(maps, length).max() < 2.5  # a pixel and a half of the search's grid
    kept = found(crops, SearchSettings(box_pixels=64, angles=24, coarse=0.0, stretch=0.0))
    np.testing.assert_allclose(lengths(kept), 1.0)
    assert errors(kept, length).max() > 2 * errors(maps, length).max()


def test_part_that_is_drawn_as_it_is_keeps_its_length():
    maps = found(drawn(1.0))
    np.testing.assert_allclose(lengths(maps), 1.0)
    assert errors(maps, 1.0).max() < 2.5


def test_stretched_templates_are_the_stretched_drawing():
    """Joints and pixels of a look with a longer shin are those of a puppet drawn with a longer shin."""
    searcher = searcher_of(LEG, STILL, SETTINGS)
    look = look_at(searcher, drawn(1.0).images[0], 0.0)
    longer = look_with(look, {1: MOST, 2: 0})
    np.testing.assert_allclose(shape_of(searcher, 1, MOST), np.diag([1.0, STEP**MOST]), atol=1e-9)
    redrawn = box_puppet([BODY, _longer(SHIN, STEP**MOST), FOOT], (), SIZE)
    shin = look_at(searcher_of(redrawn, STILL, SETTINGS), drawn(1.0).images[0], 0.0).templates
    mine = longer.templates
    assert mine.area[1] == pytest.approx(shin.area[1] * mine.scale**2 / shin.scale**2, rel=0.1)
    arm = longer.solution.links[2].from_parent[0] - longer.solution.links[1].from_child[0]
    drawn_arm = look.solution.links[2].from_parent[0] - look.solution.links[1].from_child[0]
    assert np.abs(arm - (drawn_arm * [1.0, STEP**MOST])).max() <= 1.0  # both are rounded to pixels
    np.testing.assert_array_equal(mine.pixels[mine.start[2, 0]], look.templates.pixels[look.templates.start[2, 0]])
    assert pieces_of(LEG).puppet.num_layers == 3


def _longer(box: tuple[int, int, int, int], times: float) -> tuple[int, int, int, int]:
    x, y, w, h = box
    return x, y, w, round(h * times)
