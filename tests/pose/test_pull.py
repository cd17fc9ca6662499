import numpy as np

from tests.fit.arms import HAND, cutout
from wildpuppet.pose.pull import MOST, PULL, ROUNDING, Pull
from wildpuppet.pose.templates import make_templates, palette_of, part_images
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings

SEARCH_FROM_CROP = 0.5
SHAPE = (40, 50)


def test_a_pull_is_free_where_the_point_lands_and_grows_with_the_distance() -> None:
    images = part_images(build(cutout(), PuppetSettings(edge=0.2)))
    templates = make_templates(images, 0.5, 8, palette_of(images, 0.5, 4))
    arm, angle, state = 1, 2, (2, 22, 18)
    turn = templates.radians[angle]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    landed = np.array(state[1:]) + 0.5 + 0.5 * rotation @ (np.array(HAND) - images[arm].pivot)
    pull = Pull(np.array([arm]), np.array([HAND]), landed[None] / SEARCH_FROM_CROP)
    unary = [np.zeros((8, *SHAPE), np.float32) for _ in images]
    pull.add_to(unary, images, templates, SEARCH_FROM_CROP)
    assert unary[arm][angle, 18, 22] == 0.0
    np.testing.assert_allclose(unary[arm][angle, 18, 27], PULL * (5 - ROUNDING), rtol=1e-5)
    np.testing.assert_allclose(unary[arm][angle, 15, 26], PULL * (5 - ROUNDING), rtol=1e-5)
    assert unary[arm].max() <= MOST
    assert not unary[0].any()
    states = np.array([[(0, 3, 4), (k, x, y), (0, 0, 0)] for k, x, y in ((2, 22, 18), (5, 9, 30), (0, 49, 39))])
    known = [unary[arm][k, y, x] for k, x, y in states[:, arm].tolist()]
    np.testing.assert_allclose(pull.on_states(states, images, templates, SEARCH_FROM_CROP), known, rtol=1e-4)
