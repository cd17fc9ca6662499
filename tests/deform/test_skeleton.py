import numpy as np
import torch

from tests.scene_values import true_vertices
from tests.scenes import Scene
from wildpuppet.deform.skeleton import (
    SkeletonTensors,
    poses_of,
    skeleton_from,
    skeleton_of,
    vertices_of,
    with_bends,
)
from wildpuppet.pose.tree import tree_of
from wildpuppet.types import Puppet

ROUNDING = 2e-3
"""Crop pixels: the network's numbers are float32."""


def vertices(skeleton, poses: np.ndarray) -> np.ndarray:
    return vertices_of(SkeletonTensors(skeleton), torch.from_numpy(poses).float()).numpy()


def test_turned_parts_come_back_exactly(scene: Scene, puppet: Puppet):
    truth, skeleton = true_vertices(scene, puppet), skeleton_of(puppet)
    poses = poses_of(skeleton, truth, np.ones(truth.shape[:2]))
    assert poses.shape == (len(truth), skeleton.num_numbers)
    np.testing.assert_allclose(vertices(skeleton, poses), truth, atol=ROUNDING)
    np.testing.assert_allclose(poses[:, 4 * skeleton.num_layers :], 0.0, atol=1e-9)


def test_halfway_a_limb_is_turned_by_half_and_keeps_its_length(puppet: Puppet):
    """A straight line between two poses turns a part about its hinge; one between vertices would shorten it."""
    skeleton, tree = skeleton_of(puppet), tree_of(puppet)
    edge = next(edge for edge in tree.edges if not tree.children(edge.child))
    rest = poses_of(skeleton, puppet.vertices[None], np.ones((1, len(puppet.vertices))))
    turned = rest.copy()
    turned[0, edge.child] += np.radians(120)
    half = vertices(skeleton, 0.5 * (rest + turned))[0]
    mine = puppet.layer_of_vertex == edge.child
    own = puppet.vertices[mine] - edge.at
    angle = np.radians(60)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(half[mine], own @ rotation.T + edge.at, atol=ROUNDING)
    np.testing.assert_allclose(half[~mine], puppet.vertices[~mine], atol=ROUNDING)


def test_bends_are_learnt_from_vertices(puppet: Puppet):
    """A wave across one part, of another size in every frame, is one bend."""
    amounts = np.array([-3.0, -1.0, 0.5, 2.0, 4.0])
    mine = puppet.layer_of_vertex == 0
    along = (puppet.vertices[:, 1] - puppet.vertices[mine, 1].mean()) / np.ptp(puppet.vertices[mine, 1])
    wave = np.where(mine, np.cos(4 * np.pi * along), 0.0)
    bent = np.repeat(puppet.vertices[None], len(amounts), 0)
    bent[..., 0] += amounts[:, None] * wave
    trust, stiff = np.ones(bent.shape[:2]), skeleton_of(puppet)
    bendable = with_bends(stiff, bent, trust, 1)
    assert len(bendable.bends) == len(stiff.bends) + 1
    without, with_one = (np.abs(vertices(each, poses_of(each, bent, trust)) - bent).max() for each in (stiff, bendable))
    assert without > 1.0
    assert with_one < 0.05


def test_buffers_hold_the_skeleton(puppet: Puppet):
    skeleton = skeleton_of(puppet)
    again = skeleton_from(dict(SkeletonTensors(skeleton).named_buffers()))
    poses = poses_of(again, puppet.vertices[None], np.ones((1, len(puppet.vertices))), np.zeros(skeleton.num_numbers))
    np.testing.assert_allclose(vertices(again, poses)[0], puppet.vertices, atol=ROUNDING)
