import numpy as np
import pytest

from tests.motion.dolls import ELBOW, HAND, arm, figure, run_of
from wildpuppet.motion.bones import bone_tree_of, bones_of, posed
from wildpuppet.motion.curves import Times, bulge, chord, fitted_strength
from wildpuppet.motion.inbetween import (
    KINDS,
    METHODS,
    Codes,
    Keys,
    Method,
    between,
    even_shares,
    keys_of,
    strengths_of,
    with_winding,
)
from wildpuppet.motion.passages import drawings_of, passages

EXACT = 1e-6
"""Rounding of float64 through a chain of similarities, in pixels."""
SOLVED = 2e-3
"""What the springs of the least-squares baseline give, in pixels."""
ALONE = Times(np.nan, 0.0, 1.0, np.nan)


def keys_between(first: np.ndarray, last: np.ndarray) -> Keys:
    return Keys(ALONE, np.stack([first, first, last, last]))


def bone_length(vertices: np.ndarray) -> float:
    """Distance between the two ends of the lower bone's mesh at rest, in a pose."""
    puppet = arm().puppet
    mine = np.flatnonzero(puppet.layer_of_vertex == 1)
    ends = [mine[np.argmin(np.linalg.norm(puppet.vertices[mine] - point, axis=1))] for point in (ELBOW, HAND)]
    return float(np.linalg.norm(vertices[ends[1]] - vertices[ends[0]]))


def test_bones_are_the_pose_exactly() -> None:
    doll, random = figure(), np.random.default_rng(0)
    poses = np.stack([doll.posed({name: random.normal(0, 1) for name in doll.puppet.names}) for _ in range(4)])
    poses = poses * 0.7 + random.normal(0, 2.0, poses.shape)
    tree = bone_tree_of(doll.puppet)
    assert np.abs(posed(tree, bones_of(tree, poses)) - poses).max() < EXACT


@pytest.mark.parametrize("method", ["hinges", "ours", "arap"])
def test_an_arm_that_turns_evenly_keeps_its_length(method: Method) -> None:
    """Both bones turn at constant speed, the lower one twice as fast: the truth at every share is known."""
    doll, shares = arm(), even_shares(3)
    ends = [doll.posed({"upper": share * 1.2, "lower": share * 1.4}) for share in (0.0, 1.0)]
    truth = np.stack([doll.posed({"upper": share * 1.2, "lower": share * 1.4}) for share in shares])
    tree, keys, rest = bone_tree_of(doll.puppet), keys_between(*ends), bone_length(doll.puppet.vertices)
    found = between(tree, keys, shares, method)
    assert bone_length(between(tree, keys, shares, "linear")[1]) == pytest.approx(rest * np.cos(2.6 / 2), abs=EXACT)
    assert bone_length(found[1]) == pytest.approx(rest, abs=SOLVED)
    away = found - truth  # what is open, where the arm is as a whole, is each method's own
    assert np.abs(away - away.mean(1, keepdims=True)).max() < SOLVED


def test_every_method_gives_the_keys_themselves() -> None:
    doll = figure()
    first, last = doll.posed({"torso": 0.3}), doll.posed({"torso": -0.4, "left_thigh": 1.0}, (30.0, 4.0))
    last = last + np.random.default_rng(1).normal(0, 1.0, last.shape)
    weights = np.random.default_rng(2).normal(size=(5, first.size))
    codes = Codes(np.ones(5), np.arange(5.0), lambda mixed, _: (mixed @ weights).reshape(-1, *first.shape))
    tree = bone_tree_of(doll.puppet)
    for method in METHODS:
        found = between(tree, keys_between(first, last), np.array([0.0, 1.0]), method, dict.fromkeys(KINDS, 1.0), codes)
        assert np.abs(found - np.stack([first, last])).max() < 1e-3, method


def test_a_parabola_is_drawn_exactly_from_three_keys_at_any_spacing() -> None:
    times = Times(-2.0, 0.0, 3.0, np.nan)

    def at(time: float) -> np.ndarray:
        return np.array([1.0 + 2.0 * time - 0.7 * time**2])

    keys = (at(-2.0), at(0.0), at(3.0), at(0.0))
    for share in (0.2, 0.5, 0.9):
        curve = chord(keys[1], keys[2], share) + bulge(keys, times, share)
        assert curve == pytest.approx(at(3.0 * share))
    both = Times(-2.0, 0.0, 3.0, 4.0)
    curve = chord(keys[1], keys[2], 0.3) + bulge((*keys[:3], at(4.0)), both, 0.3)
    assert curve == pytest.approx(at(0.9))


def test_strength_is_the_share_of_the_bulge_that_the_drawings_have() -> None:
    random = np.random.default_rng(0)
    bulges = random.normal(size=(40, 6))
    missed = 0.8 * bulges + random.normal(0, 0.01, bulges.shape)
    missed[3] += 50.0  # a wrong fit
    assert fitted_strength(missed, bulges, 0.8) == pytest.approx(0.8, abs=0.03)
    assert fitted_strength(random.normal(size=(40, 6)), bulges, 0.0) < 0.2
    assert fitted_strength(np.zeros((0, 6)), np.zeros((0, 6)), 0.75) == 0.75


def test_turns_along_a_curve_are_learnt_from_the_run() -> None:
    """An arm whose speed grows evenly: after learning, ours is nearer than constant speed by far."""
    doll = arm()
    poses = np.stack([doll.posed({"lower": 0.01 * t**2}) for t in range(14)])
    drawings = drawings_of(*run_of(doll, poses, (300, 300)))
    tree, keys = bone_tree_of(doll.puppet), keys_of(drawings, 6, 10)
    strengths = strengths_of(tree, drawings, 6, 10)
    assert strengths["turns"] == pytest.approx(1.0, abs=0.2)
    found = {method: between(tree, keys, np.array([0.5]), method, strengths)[0] for method in ("ours", "hinges")}
    error = {method: np.linalg.norm(pose - poses[8], axis=1).mean() for method, pose in found.items()}
    assert error["ours"] < 0.25 * error["hinges"]


def test_a_limb_turns_the_way_the_run_has_it_turn() -> None:
    """It swings to and fro through 0; between its ends at +110 and -110 degrees the short way is the wrong one."""
    doll, far = arm(), np.radians(110)
    poses = np.stack([doll.posed({"lower": far * np.cos(np.pi * t / 6)}) for t in range(13)])
    drawings, tree = drawings_of(*run_of(doll, poses, (300, 300))), bone_tree_of(doll.puppet)
    keys = keys_of(drawings, 0, 6)
    short, right = (
        between(tree, each, np.array([0.5]), "hinges")[0] for each in (keys, with_winding(tree, drawings, keys))
    )
    away = [
        np.linalg.norm(pose - pose.mean(0) - (poses[3] - poses[3].mean(0)), axis=1).max() for pose in (short, right)
    ]
    assert away[1] < EXACT
    assert away[0] > 50.0


def test_a_passage_ends_where_the_puppet_jumps() -> None:
    doll = arm()
    first = [doll.posed({"upper": 0.1 * t}) for t in range(6)]
    second = [doll.posed({"upper": 2.5 + 0.1 * t}) for t in range(6)]
    poses = np.stack(first + second)
    assert passages(poses, np.zeros(12, np.int64)).tolist() == [0] * 6 + [1] * 6
    assert passages(poses[:6], np.array([0, 0, 0, 1, 1, 1])).tolist() == [0, 0, 0, 1, 1, 1]
    crops, fit = run_of(doll, poses, (300, 300))
    assert np.isnan(keys_of(drawings_of(crops, fit), 4, 5).times.after)
