import numpy as np
import pytest

from tests.correspond.test_pck import truth
from wildpuppet.correspond.compare import Carried, compare, means


def test_rows_and_means_by_group():
    hand, rig = truth(("Left-Hand", "Right-Hand"), test=np.array([3])), truth(num_points=4)
    wrong = hand.points.copy()
    wrong[3] += 1000.0
    trust = np.where(np.arange(4) == 3, 0.2, 0.9)[:, None] * np.ones((1, 2))
    rows = compare("fox", "drawings", hand, {"copy": Carried(hand.points), "ours": Carried(wrong, hand.visible, trust)})
    rows += compare("robot", "drawings", rig, {"copy": Carried(rig.points)})
    rows += compare("dino", "drawings", hand, {"copy": Carried(wrong)})
    rows += compare("robot", "clip", rig, {"ours": Carried(rig.points)})
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
    assert [row.score.auroc for row in rows[:4]] == [None, None, 1.0, None]
    assert averaged["hand", "all", "ours"].score.auroc == 1.0
