"""Dragging among known poses: exact where they lead, better than the vertices alone in between, sane beyond."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.motion.dolls import Doll, arm, figure, run_of, truth_of, walk
from wildpuppet.correspond.pck import Truth
from wildpuppet.fit.handles import Handles, joint_rows
from wildpuppet.fit.pull_codes import decode, decode_with_jacobian
from wildpuppet.motion.drag import Known, drag
from wildpuppet.motion.pose_space import PoseSpace, pose_space_of
from wildpuppet.tables.drags import drag_scores

torch.set_num_threads(1)
SIZE = (360, 280)
UNIT = 2 / 360


@pytest.fixture(scope="module")
def doll() -> Doll:
    return figure()


def known_of(space: PoseSpace, poses: np.ndarray, start: int = 0) -> Known:
    return Known(poses, space.encode(poses, poses[start]), space.turnings())


def vertex_handles(doll: Doll, vertices: list[int], targets: np.ndarray) -> Handles:
    triangles = np.stack([doll.puppet.triangles[(doll.puppet.triangles == v).any(1)][0] for v in vertices])
    return Handles(triangles.astype(np.int64), (triangles == np.array(vertices)[:, None]).astype(float), targets)


def farthest(doll: Doll, part: str, pose: np.ndarray) -> int:
    """The vertex of a part that is farthest from its hinge: a hand, a foot."""
    mine = np.flatnonzero(doll.puppet.layer_of_vertex == doll.puppet.names.index(part))
    hinge = np.array(doll.hinges[part])
    return int(mine[np.linalg.norm(doll.puppet.vertices[mine] - hinge, axis=1).argmax()])


def test_codes_of_poses_decode_to_them(doll: Doll) -> None:
    poses = walk(doll, 10) + np.random.default_rng(0).normal(0, 1.5, (10, len(doll.puppet.vertices), 2))
    space = pose_space_of(doll.puppet)
    codes = space.encode(poses, poses[4])
    for code, pose in zip(codes, poses, strict=True):
        np.testing.assert_allclose(decode(space, code), pose, atol=1e-8)


def test_codes_halfway_turn_parts_about_their_hinges(doll: Doll) -> None:
    turns = {"left_upper_arm": 1.2, "left_forearm": -0.8, "torso": 0.3, "head": -0.4}
    half = {part: angle / 2 for part, angle in turns.items()}
    space = pose_space_of(doll.puppet)
    codes = space.encode(np.stack([doll.posed({}), doll.posed(turns)]))
    found, right = decode(space, codes.mean(0)), doll.posed(half)
    torso = doll.puppet.layer_of_vertex == doll.puppet.names.index("torso")
    assert space.tree.root == doll.puppet.names.index("torso")  # its middle goes straight, not about its hinge
    np.testing.assert_allclose(found - found[torso].mean(0), right - right[torso].mean(0), atol=0.05)


def test_codes_take_the_short_way_from_a_pose() -> None:
    """An arm that goes from 170 to 190 degrees turns by 20, not by -340."""
    doll = arm()
    space = pose_space_of(doll.puppet)
    poses = np.stack([doll.posed({"lower": np.radians(angle)}) for angle in (170, 190, 180)])
    codes = space.encode(poses[:2], poses[0])
    np.testing.assert_allclose(decode(space, codes.mean(0)), poses[2], atol=0.05)


def test_the_decoders_jacobian_is_that_of_finite_differences(doll: Doll) -> None:
    poses = walk(doll, 6)
    space = pose_space_of(doll.puppet)
    codes = space.encode(poses)
    directions = np.concatenate([codes[1:3] - codes[0], space.turnings()[:3]])
    _, moved = decode_with_jacobian(space, codes[0], directions)
    for along, found in zip(directions, np.moveaxis(moved, -1, 0), strict=True):
        slope = (decode(space, codes[0] + 1e-5 * along) - decode(space, codes[0] - 1e-5 * along)) / 2e-5
        np.testing.assert_allclose(found, slope, atol=1e-4)


def test_handles_that_stay_leave_the_pose(doll: Doll) -> None:
    poses = walk(doll, 12)
    space = pose_space_of(doll.puppet)
    vertices = [farthest(doll, "left_shin", poses[5]), farthest(doll, "right_forearm", poses[5])]
    handles = vertex_handles(doll, vertices, poses[5][vertices])
    found = drag(doll.puppet, space, known_of(space, poses, 5), 5, handles, UNIT)
    np.testing.assert_allclose(found.vertices, poses[5], atol=1e-3)


def test_two_points_dragged_to_an_unseen_step_take_the_whole_walk_along(doll: Doll) -> None:
    poses = walk(doll, 33)
    seen, unseen = poses[::2], poses[9]
    space = pose_space_of(doll.puppet)
    vertices = [farthest(doll, part, poses[4]) for part in ("left_shin", "right_forearm")]
    handles = vertex_handles(doll, vertices, unseen[vertices])
    found = drag(doll.puppet, space, known_of(space, seen, 3), 3, handles, UNIT)
    assert handles.missing(found.vertices).max() < 1e-3
    error, start = (np.linalg.norm(pose - unseen, axis=1).mean() for pose in (found.vertices, seen[3]))
    assert error < 0.2 * start


def test_a_drag_to_where_no_pose_leads_turns_parts_and_keeps_them_whole(doll: Doll) -> None:
    poses = walk(doll, 12)
    space = pose_space_of(doll.puppet)
    vertex = farthest(doll, "left_forearm", poses[5])
    shoulder = np.flatnonzero(doll.puppet.layer_of_vertex == doll.puppet.names.index("left_upper_arm"))
    target = poses[5][shoulder].mean(0) + np.array([0.0, -45.0])
    handles = vertex_handles(doll, [vertex], target[None])
    assert handles.missing(poses[5]).max() > 50
    found = drag(doll.puppet, space, known_of(space, poses, 5), 5, handles, UNIT)
    assert handles.missing(found.vertices).max() < 1e-3
    np.testing.assert_allclose(
        joint_rows(doll.puppet) @ found.vertices, joint_rows(doll.puppet) @ found.decoded, atol=1e-3
    )
    sizes = [np.linalg.norm(pose[doll.puppet.triangles] - np.roll(pose[doll.puppet.triangles], 1, 1), axis=-1)
             for pose in (poses[5], found.vertices)]  # fmt: skip
    assert np.median(np.abs(sizes[1] / sizes[0] - 1)) < 0.02
    assert np.abs(sizes[1] / sizes[0] - 1).max() < 0.6


def test_one_known_pose_is_enough(doll: Doll) -> None:
    poses = walk(doll, 1)
    space = pose_space_of(doll.puppet)
    vertex = farthest(doll, "right_shin", poses[0])
    handles = vertex_handles(doll, [vertex], poses[0][[vertex]] + [[12.0, -9.0]])
    found = drag(doll.puppet, space, known_of(space, poses), 0, handles, UNIT)
    assert handles.missing(found.vertices).max() < 1e-3
    head = doll.puppet.layer_of_vertex == doll.puppet.names.index("head")
    assert np.linalg.norm(found.vertices - poses[0], axis=1)[head].max() < 6.0


def scored(doll: Doll, by_truth: bool, noise: float = 0.0) -> tuple[float, ...]:
    poses = walk(doll, 32)
    truth: Truth = replace(truth_of(doll, poses), test=np.arange(3, 32, 6))
    away = np.random.default_rng(0).normal(0, noise, (32, 1, 2))
    away[truth.reference] = 0.0  # where the points are tied to the mesh
    crops, fit = run_of(doll, poses + away, SIZE)
    scores = drag_scores(doll.puppet, crops, fit, truth, by_truth)
    assert scores.frames == tuple(truth.test.tolist())
    assert scores.mean("paper", 1) <= scores.mean("start", 1) + 1e-6
    return tuple(scores.ratio(count) for count in (1, 2, 3))


def test_known_poses_halve_the_baselines_error(doll: Doll) -> None:
    assert max(scored(doll, by_truth=False)) < 0.5


def test_poses_by_truth_do_not_ask_the_fit(doll: Doll) -> None:
    assert max(scored(doll, by_truth=True, noise=20.0)) < 0.5
