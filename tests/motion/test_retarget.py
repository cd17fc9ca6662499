from dataclasses import replace

import numpy as np
import pytest

from tests.figure import LIMBS, Limb
from tests.motion.dolls import Doll, figure, walk
from wildpuppet.motion.bones import bone_tree_of, bones_of, turns_of
from wildpuppet.motion.retarget import carried_order, match_parts, retarget

FRAMES = 6


def stretched(limb: Limb, along: float) -> Limb:
    """The figure drawn ``along`` times as tall, as thick as before."""

    def moved(point: tuple[float, float]) -> tuple[float, float]:
        return point[0], 20.0 + along * (point[1] - 20.0)

    strokes = tuple((moved(start), moved(end), first, last) for start, end, first, last in limb.strokes)
    return replace(limb, hinge=moved(limb.hinge), strokes=strokes)


@pytest.fixture(scope="module")
def short() -> Doll:
    return figure(tuple(stretched(limb, 0.7) for limb in LIMBS))


def turns(doll: Doll, poses: np.ndarray) -> dict[str, np.ndarray]:
    tree = bone_tree_of(doll.puppet)
    return dict(zip(doll.puppet.names, turns_of(tree, bones_of(tree, poses)).T, strict=True))


def root_places(doll: Doll, poses: np.ndarray) -> np.ndarray:
    return bones_of(bone_tree_of(doll.puppet), poses).places


def test_parts_of_the_same_name_turn_alike_on_other_limbs(short: Doll) -> None:
    long, poses = figure(), walk(figure(), FRAMES)
    match = match_parts(long.puppet, short.puppet)
    assert len(match.pairs) == len(LIMBS)
    found = retarget(long.puppet, poses, np.zeros(FRAMES, np.int64), short.puppet, match)
    wanted, got = turns(long, poses), turns(short, found)
    for name in long.puppet.names:
        away = np.angle(np.exp(1j * (wanted[name] - got[name])))
        assert np.abs(away).max() < 1e-9, name
    joints = found[:, short.puppet.joint_vertices] * short.puppet.joint_weights[..., None]
    assert np.abs(np.diff(joints.sum(-2), axis=2)).max() < 1e-6


def test_it_is_as_tall_and_walks_as_far_as_asked(short: Doll) -> None:
    long, poses = figure(), walk(figure(), FRAMES)
    match, shots = match_parts(long.puppet, short.puppet), np.zeros(FRAMES, np.int64)
    tall = np.ptp(long.puppet.vertices[:, 1])
    for height in (1.0, 0.5):
        found = retarget(long.puppet, poses, shots, short.puppet, match, height)
        size = np.exp(bones_of(bone_tree_of(short.puppet), found).log_scales[:, bone_tree_of(short.puppet).root])
        assert size * np.ptp(short.puppet.vertices[:, 1]) == pytest.approx(height * tall, rel=1e-6)
        ways = [root_places(doll, each) for doll, each in ((short, found), (long, poses))]
        assert ways[0] - ways[0][0] == pytest.approx(height * (ways[1] - ways[1][0]), abs=1e-6)
        ground = found[..., 1].max(1) - poses[..., 1].max(1)
        assert np.median(ground) == pytest.approx(0.0, abs=1e-6)


def test_parts_without_a_namesake_keep_their_drawn_pose(short: Doll) -> None:
    long, poses = figure(), walk(figure(), FRAMES)
    names = tuple(name.replace("left_shin", "claw").replace("head", "07-Head") for name in short.puppet.names)
    other = replace(short.puppet, names=names)
    match = match_parts(long.puppet, other)
    assert match.at_rest == ("claw",)
    assert match.unused == ("left_shin",)
    found = turns(replace(short, puppet=other), retarget(long.puppet, poses, np.zeros(FRAMES, np.int64), other, match))
    assert np.abs(found["claw"] - found["left_thigh"]).max() < 1e-9
    assert np.abs(found["07-Head"] - turns(long, poses)["head"]).max() < 1e-9
    given = match_parts(long.puppet, other, {"claw": "right_shin"})
    assert ("right_shin", "claw") in {(long.puppet.names[a], names[b]) for a, b in given.pairs}


def test_the_order_changes_only_where_the_other_changes_it(short: Doll) -> None:
    long = figure().puppet
    reversed_drawn = replace(short.puppet, names=short.puppet.names[::-1])
    match = match_parts(long, reversed_drawn)
    rest = np.arange(long.num_layers)
    changed = rest.copy()
    changed[[0, 1]] = [1, 0]
    order = carried_order(np.stack([rest, changed]), long, reversed_drawn, match)
    assert order[0].tolist() == rest.tolist()
    assert sorted(order[1].tolist()) == rest.tolist()
    assert order[1].tolist() != rest.tolist()
