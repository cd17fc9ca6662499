import numpy as np
import pytest

from tests.correspond.test_pck import truth
from wildpuppet.correspond.compare import compare, means


def test_rows_and_means_by_group():
    hand, rig = truth(("Left-Hand", "Right-Hand"), test=np.array([3])), truth(num_points=4)
    wrong = hand.points.copy()
    wrong[3] += 1000.0
    rows = compare("fox", "drawings", hand, {"copy": (hand.points, None), "ours": (wrong, hand.visible)})
    rows += compare("robot", "drawings", rig, {"copy": (rig.points, None)})
    rows += compare("dino", "drawings", hand, {"copy": (wrong, None)})
    rows += compare("robot", "clip", rig, {"ours": (rig.points, None)})
    assert [(row.name, row.group, row.frames, row.method) for row in rows[:4]] == [
        ("fox", "hand", "all", "copy"),
        ("fox", "hand", "test", "copy"),
        ("fox", "hand", "all", "ours"),
        ("fox", "hand", "test", "ours"),
    ]
    assert [row.score.pck[0.1] for row in rows[:4]] == [100, 100, pytest.approx(66.67), 0]
    averaged = {(row.group, row.frames, row.method): row for row in means(rows)}
    assert averaged["hand", "all", "copy"].score.pck[0.1] == pytest.approx(83.33, abs=0.02)
    assert averaged["hand", "test", "copy"].score.pck[0.1] == 50
    assert averaged["hand", "all", "copy"].score.swaps == 0
    assert averaged["hand", "all", "copy"].num_sets == 2
    assert averaged["rigs", "all", "copy"].score.swaps is None
    assert averaged["clips", "all", "ours"].name == "mean of 1 clips"
