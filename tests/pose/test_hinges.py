"""Two parts that turn against each other show their hinge."""

from dataclasses import replace

import numpy as np
import pytest

from tests.pose.boxes import box_puppet, crops_around
from wildpuppet.geometry import affine
from wildpuppet.pose.hinges import hinge_places, sample_of, with_hinges
from wildpuppet.pose.tree import joint_points

TRUE = np.array([40.0, 22.0])
PUPPET = box_puppet([(10, 10, 30, 24), (36, 16, 24, 12)], [(0, 1, (36.0, 26.0))], canvas=(80, 48))
"""The hinge is told 5.7 pixels beside where it is."""


def motion(seed: int, num: int = 10, turn: float = 1.0) -> np.ndarray:
    """Turn the second part about TRUE, the first freely, all at sizes of their own."""
    rng = np.random.default_rng(seed)
    body = affine.similarity(rng.uniform(0.5, 2.0, num), rng.uniform(-3, 3, num), rng.uniform(-50, 50, (num, 2)))
    limb = affine.similarity(np.ones(num), rng.uniform(-turn, turn, num), np.zeros((num, 2)))
    limb[:, :, 2] = TRUE - limb[:, :, :2] @ TRUE
    return np.stack([body, affine.compose(body, limb)], 1)


@pytest.mark.parametrize("seed", range(3))
def test_the_hinge_is_found_from_motion(seed: int) -> None:
    place = hinge_places(PUPPET, motion(seed, num=40))[0]
    assert np.linalg.norm(place - TRUE) < 0.5


def test_drawings_that_were_misread_do_not_move_it() -> None:
    maps = motion(3, num=40)
    maps[:12, 1, :, 2] += np.random.default_rng(0).uniform(20, 40, (12, 2))
    assert np.linalg.norm(hinge_places(PUPPET, maps)[0] - TRUE) < 0.7


def test_parts_that_never_turn_keep_their_hinge() -> None:
    guess = joint_points(PUPPET).mean(1)
    np.testing.assert_allclose(hinge_places(PUPPET, motion(4, turn=0.0)), guess, atol=1e-6)


def test_a_moved_hinge_closes_at_rest() -> None:
    moved = with_hinges(PUPPET, TRUE[None])
    np.testing.assert_allclose(joint_points(moved), np.broadcast_to(TRUE, (1, 2, 2)), atol=1e-9)


def test_the_sample_is_of_distinct_drawings_that_were_seen() -> None:
    crops = crops_around(9, drawing=[0, 0, 1, 1, 2, 3, 3, 4, 5])
    crops = replace(crops, state=("followed",) * 5 + ("lost",) + ("followed",) * 3)
    assert list(sample_of(crops, 100)) == [0, 2, 4, 7, 8]
    assert list(sample_of(crops, 3)) == [0, 4, 8]
