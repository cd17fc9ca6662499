import numpy as np
import pytest

from wildpuppet.correspond.pck import Truth, auroc, mirror_twins, read_truth, score
from wildpuppet.errors import InputError


def truth(names=(), num_points=2, test=None):
    points = np.zeros((4, num_points, 2))
    points[..., 0] = np.arange(num_points) * 50.0
    return Truth(
        points=points,
        visible=np.ones((4, num_points), bool),
        part=np.zeros(num_points, int),
        reference=1,
        length=np.full(4, 100.0),
        test=test,
        names=names,
    )


def test_errors_just_under_and_at_the_limit():
    gt = truth()
    carried = gt.points.copy()
    carried[0, 0, 0] += 9.99  # right at .1
    carried[2, 1, 1] += 10.0  # wrong: the limit itself does not count
    carried[3, 0] = np.nan  # not given
    carried[1] += 1000  # the reference does not count
    result = score(gt, carried)
    assert result.num_points == 6
    assert result.pck == {0.1: 66.67, 0.05: 50.0, 0.025: 50.0, 0.0125: 50.0}
    assert score(gt, carried, frames=np.array([0, 1])).pck[0.1] == 100.0


def test_only_points_seen_in_both_frames_count_and_hidden_ones_apart():
    gt = truth(num_points=12)
    gt.visible[1, 0] = False  # not seen in the reference: never counts
    gt.visible[2:, 1:] = False
    gt.points[3, 5] = np.nan  # nobody knows where it is
    carried = np.nan_to_num(gt.points)
    carried[2, 1] += 6.0
    result = score(gt, carried, visible=np.ones_like(gt.visible))
    assert result.num_points == 11
    assert result.hidden == {0.1: 100.0, 0.05: 95.24}
    assert result.visible_accuracy == pytest.approx(100 * 11 / 32, abs=0.01)
    assert score(gt, carried, frames=np.array([2])).hidden is None


def test_clips_are_measured_by_the_box(tmp_path):
    gt = truth()
    boxes = np.array([[0, 0, 10, 40]] * 4, np.float32)
    np.savez(tmp_path / "gt.npz", points=gt.points, visible=gt.visible, part=gt.part, reference=1, boxes=boxes)
    carried = gt.points + np.array([3.9, 0.0])
    assert score(read_truth(tmp_path / "gt.npz"), carried).pck == {0.1: 100.0, 0.05: 0.0, 0.025: 0.0, 0.0125: 0.0}
    (tmp_path / "other.npz").write_bytes(b"no")
    with pytest.raises(InputError, match="ground truth"):
        read_truth(tmp_path / "other.npz")


def test_swaps_are_points_on_their_mirror_twin():
    names = ("Left-Hand", "Right-Hand", "Head")
    assert mirror_twins(names).tolist() == [1, 0, -1]
    gt = truth(names, num_points=3)
    carried = gt.points.copy()
    carried[0, :2] = carried[0, 1::-1]
    assert score(gt, carried).swaps == pytest.approx(33.33)
    assert score(truth(("a", "b")), truth().points).swaps is None


def test_auroc_counts_pairs_and_ties_by_half():
    wrong = np.array([True, True, False, False, False])
    assert auroc(wrong, np.array([0.1, 0.2, 0.3, 0.4, 0.9])) == 1.0
    assert auroc(wrong, np.array([0.9, 0.8, 0.3, 0.4, 0.1])) == 0.0
    assert auroc(wrong, np.full(5, 0.7)) == 0.5
    assert auroc(wrong, np.array([0.3, 0.5, 0.3, 0.4, 0.9])) == pytest.approx((0.5 + 1 + 1 + 0 + 0 + 1) / 6, abs=1e-4)
    assert auroc(np.ones(3, bool), np.arange(3.0)) is None
    assert auroc(np.zeros(3, bool), np.arange(3.0)) is None


def test_confidence_is_judged_on_visible_points_at_a_twentieth():
    gt = truth(num_points=3)
    carried = gt.points.copy()
    carried[0, 0, 0] += 4.99  # still right
    carried[2, 1, 1] += 5.0  # wrong
    carried[3, 2] += 50.0  # wrong, but hidden
    gt.visible[3, 2] = False
    confidence = np.full((4, 3), 0.5)
    confidence[2, 1], confidence[0, 0], confidence[3, 2], confidence[1] = 0.4, 0.3, 0.9, 0.0
    assert score(gt, carried, confidence=confidence).auroc == pytest.approx(6 / 7, abs=1e-4)
    assert score(gt, carried).auroc is None
