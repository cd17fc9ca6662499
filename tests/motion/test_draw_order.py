import numpy as np

from tests.motion.dolls import arm
from wildpuppet.motion.draw_order import changing_spans, orders_between


def test_groups_that_change_their_order_among_themselves() -> None:
    first, last = np.array([0, 1, 2, 3, 4, 5]), np.array([1, 0, 2, 5, 3, 4])
    assert changing_spans(first, last) == [(0, 2), (3, 6)]
    assert changing_spans(first, first) == []


def test_a_bone_goes_behind_the_other_where_it_does_not_cover_it() -> None:
    """The lower bone folds over the upper one, straightens at the fourth inbetween, and folds the other way."""
    doll = arm()
    angles = [3.0, 2.6, 2.2, 0.0, -2.2, -2.6, -3.0]
    poses = np.stack([doll.posed({"lower": angle}) for angle in angles])
    found = orders_between(doll.puppet, poses, np.array([0, 1]), np.array([1, 0]))
    changes = [t for t in range(1, len(found)) if (found[t] != found[t - 1]).any()]
    assert changes in ([3], [4])
    assert found[0].tolist() == [0, 1]
    assert found[-1].tolist() == [1, 0]


def test_without_a_better_moment_it_changes_midway() -> None:
    doll = arm()
    poses = np.repeat(doll.posed({"lower": 3.0})[None], 5, 0)
    found = orders_between(doll.puppet, poses, np.array([0, 1]), np.array([1, 0]))
    assert [row[0] for row in found.tolist()] in ([0, 0, 1, 1, 1], [0, 0, 0, 1, 1])
