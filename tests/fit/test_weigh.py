"""A man with a spear, drawn by OpenCV: the search's best hypothesis holds it upside down."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from tests.fit.arms import PLACE, SIZE, about_shoulder, cutout
from wildpuppet.fit.weigh import LIKELY, weigh
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.puppet.build import build
from wildpuppet.settings import FitSettings, PuppetSettings
from wildpuppet.types import Crops, CutOut, Hypotheses, JointSpec, Part, Poses, Puppet

SIDE = 160
HAND, TIP, BUTT = (100.0, 80.0), (100, 14), (100, 142)
MIDDLE = (100.0, (TIP[1] + BUTT[1]) / 2)
TURNS = np.radians([0.0, 25.0, -50.0])
"""How far the spear is turned about the hand in each drawing."""


def layer(name: str) -> np.ndarray:
    picture = np.zeros((SIDE, SIDE, 4), np.uint8)
    if name == "body":
        cv2.circle(picture, (66, 80), 38, (90, 150, 230, 255), -1, cv2.LINE_AA)
        cv2.circle(picture, (56, 68), 7, (250, 240, 60, 255), -1, cv2.LINE_AA)
    else:
        cv2.line(picture, TIP, BUTT, (120, 80, 40, 255), 3, cv2.LINE_AA)
        blade = np.array([TIP, (TIP[0] - 5, TIP[1] + 16), (TIP[0] + 5, TIP[1] + 16)])
        cv2.fillPoly(picture, [blade], (200, 210, 220, 255), cv2.LINE_AA)
    return picture


def turned(about: tuple[float, float], radians: float) -> np.ndarray:
    spin = affine.similarity(np.array(1.0), np.array(radians), np.zeros(2))
    spin[:, 2] = np.array(about) - spin[:, :2] @ np.array(about)
    return spin


def true_maps() -> np.ndarray:
    """Crop from canvas of body and spear, (T, 2, 2, 3)."""
    return np.stack([np.stack([turned(HAND, 0.0), turned(HAND, turn)]) for turn in TURNS])


def shown(layers: Sequence[np.ndarray], maps: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Lay parts over one another, (H, W, 4)."""
    picture = np.zeros((size[1], size[0], 4), np.uint8)
    for rgba, way in zip(layers, maps, strict=True):
        part = cv2.warpAffine(rgba, affine.for_opencv(way), size, flags=cv2.INTER_AREA)
        share = part[..., 3:] / 255.0
        picture = np.rint(part * share + picture * (1 - share)).astype(np.uint8)
    return picture


def pictures() -> np.ndarray:
    layers = [layer(name) for name in ("body", "spear")]
    return np.stack([shown(layers, maps, (SIDE, SIDE)) for maps in true_maps()])


@pytest.fixture(scope="module")
def puppet() -> Puppet:
    parts = tuple(Part(name, layer(name)) for name in ("body", "spear"))
    return build(CutOut((SIDE, SIDE), parts, (JointSpec(("body", "spear"), HAND),)), PuppetSettings())


@pytest.fixture(scope="module")
def crops() -> Crops:
    number = len(TURNS)
    return Crops(
        np.arange(number), (SIDE, SIDE), np.tile(np.eye(2, 3), (number, 1, 1)), pictures(),
        np.tile([28.0, 14.0, 80.0, 130.0], (number, 1)), np.arange(number), np.zeros(number, int),
        ("followed",) * number, None, False,
    )  # fmt: skip


def hypotheses(first: np.ndarray, second: np.ndarray, second_cost: float) -> Hypotheses:
    """Two poses per drawing; the first costs 1."""
    number = len(TURNS)
    cost = np.tile([1.0, second_cost], (number, 1))
    return Hypotheses(np.stack([first, second], 1), np.tile(np.arange(2), (number, 2, 1)), cost)


def upside_down() -> np.ndarray:
    """The true maps but for the spear's, which is turned end for end about its own middle."""
    maps = true_maps()
    maps[:, 1] = affine.compose(maps[:, 1], turned(MIDDLE, np.pi))
    return maps


def weighed(puppet: Puppet, crops: Crops, given: Hypotheses) -> Poses:
    return weigh(puppet, crops, given, slice(0, len(TURNS)), FitSettings(), Machine(workers=1))


def test_a_spear_upside_down_covers_most_of_what_it_should():
    """What makes it hard: with its ends exchanged it hides more than three quarters of its own pixels."""
    way = turned(MIDDLE, np.pi)
    right = layer("spear")[..., 3] > 127
    wrong = cv2.warpAffine(layer("spear"), affine.for_opencv(way), (SIDE, SIDE))[..., 3] > 127
    assert (right & wrong).sum() > 0.75 * right.sum()


def test_the_fit_s_energy_turns_a_spear_that_the_search_took_upside_down(puppet, crops):
    found = weighed(puppet, crops, hypotheses(upside_down(), true_maps(), 1.1))
    np.testing.assert_array_equal(found.crop_from_canvas, true_maps())
    np.testing.assert_allclose(found.cost, 1.1)
    np.testing.assert_allclose(found.margin, -0.1)


def test_what_the_search_found_dear_is_not_weighed(puppet, crops):
    found = weighed(puppet, crops, hypotheses(upside_down(), true_maps(), LIKELY + 0.01))
    np.testing.assert_array_equal(found.crop_from_canvas, upside_down())


def test_the_best_stays_where_another_does_not_explain_far_more(puppet, crops):
    nudged = true_maps()
    nudged[:, 1, :, 2] += 1.0
    for first, second in ((true_maps(), upside_down()), (nudged, true_maps())):
        found = weighed(puppet, crops, hypotheses(first, second, 1.05))
        np.testing.assert_array_equal(found.crop_from_canvas, first)
        np.testing.assert_allclose(found.margin, 0.05)


def test_nothing_overrules_the_search_where_that_is_switched_off(puppet, crops):
    given = hypotheses(upside_down(), true_maps(), 1.1)
    found = weigh(puppet, crops, given, slice(0, len(TURNS)), FitSettings(overrule=0.0), Machine(workers=1))
    np.testing.assert_array_equal(found.crop_from_canvas, upside_down())


def test_limbs_that_trade_places_are_left_to_the_search():
    """Two arms that look alike: the pose in which they stand as drawn is not taken for the one with them traded."""
    arms = cutout()
    puppet = build(arms, PuppetSettings(slender=0.0))
    order = np.arange(3)
    straight = np.stack([PLACE, about_shoulder(-0.5), about_shoulder(0.5)])
    traded = straight[[0, 2, 1]]
    picture = shown([part.rgba for part in arms.parts], straight, SIZE)[None]
    assert puppet.names == ("body", "first", "second")
    crops = Crops(
        np.arange(1), SIZE, np.eye(2, 3)[None], picture, np.array([[20.0, 10.0, 70.0, 80.0]]), np.arange(1),
        np.zeros(1, int), ("followed",), None, False,
    )  # fmt: skip
    away = traded.copy()
    away[1:, :, 2] += (0.0, 25.0)  # both arms where nothing is: the straight pose costs far less
    given = Hypotheses(np.stack([away, straight])[None], np.tile(order, (1, 2, 1)), np.array([[1.0, 1.1]]))
    found = weigh(puppet, crops, given, slice(0, 1), FitSettings(), Machine(workers=1))
    np.testing.assert_array_equal(found.crop_from_canvas[0], away)
    same = Hypotheses(np.stack([away[[0, 2, 1]], straight])[None], np.tile(order, (1, 2, 1)), np.array([[1.0, 1.1]]))
    found = weigh(puppet, crops, same, slice(0, 1), FitSettings(), Machine(workers=1))
    np.testing.assert_array_equal(found.crop_from_canvas[0], straight)
