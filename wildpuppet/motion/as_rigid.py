"""As-rigid-as-possible interpolation of two posed meshes: the baseline (Alexa, Cohen-Or and Levin 2000).

Every triangle's map from rest is a turn times a symmetric stretch. Between two poses the turn's angle and the stretch
go linearly, each triangle by itself; the vertices are those whose triangles come nearest to that, in the sense of
least squares weighted by area (a Poisson equation), with stiff springs that keep the joints' gaps where linear motion
has them. What the equation leaves open, where each free piece of the puppet is, moves linearly. At both ends it gives
the pose itself.

A triangle's angle is taken near its part's, so that a limb that turns by 170 degrees turns in one piece, and the part
turns the short way against its parent.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.linalg import splu

from wildpuppet.geometry import affine
from wildpuppet.geometry.arap import arap_rest
from wildpuppet.motion.bones import BoneTree, bones_of, turns_of, unwound, wrapped

JOINT_WEIGHT = 100.0
"""Weight of a joint's spring, where a mesh edge weighs about 1 (the equation is the cotangent Laplacian)."""
HOLD = 1e-9
"""Pull of every vertex towards where linear motion has it, in the same units: it decides only what is open."""


@dataclass(frozen=True, eq=False)
class AsRigid:
    """A puppet's equation, factored once.

    ``gradient`` (2F, V) takes a coordinate of the vertices to rows of the triangles' Jacobians, ``from_gradient`` and
    ``from_joints`` take what these ought to be to the right-hand side.
    """

    tree: BoneTree
    gradient: sparse.csr_array
    joints: sparse.csr_array
    from_gradient: sparse.csr_array
    from_joints: sparse.csr_array
    solve: Callable[[Float[np.ndarray, "V 2"]], Float[np.ndarray, "V 2"]]


def as_rigid_of(tree: BoneTree) -> AsRigid:
    """Prepare a puppet."""
    puppet = tree.puppet
    rest = arap_rest(puppet.vertices.astype(np.float64), puppet.triangles)
    count = len(puppet.vertices)
    gradient, joints = _gradient_rows(rest.inverses, puppet.triangles, count), _joint_rows(tree)
    from_gradient = sparse.csr_array(gradient.T @ sparse.diags_array(np.repeat(rest.areas, 2)))
    from_joints = sparse.csr_array(JOINT_WEIGHT * joints.T)
    normal = from_gradient @ gradient + from_joints @ joints + HOLD * sparse.eye_array(count)
    solve = splu(sparse.csc_array(normal)).solve
    return AsRigid(tree, gradient, joints, from_gradient, from_joints, solve)


def as_rigid_between(
    equation: AsRigid,
    first: Float[np.ndarray, "V 2"],
    last: Float[np.ndarray, "V 2"],
    shares: Float[np.ndarray, "N"],
) -> Float[np.ndarray, "N V 2"]:
    """Interpolate two poses at ``shares`` of the way."""
    ends = np.stack([first, last]).astype(np.float64)
    angles, stretches = _turned_and_stretched(equation, ends)
    places = []
    for share in shares.tolist():
        linear = (1.0 - share) * ends[0] + share * ends[1]
        turn = _rotations((1.0 - share) * angles[0] + share * angles[1])
        wanted = turn @ ((1.0 - share) * stretches[0] + share * stretches[1])
        rows = np.swapaxes(wanted, -1, -2).reshape(-1, 2)
        gaps = equation.joints @ linear
        right = equation.from_gradient @ rows + equation.from_joints @ gaps + HOLD * linear
        places.append(equation.solve(right))
    return np.stack(places) if places else np.zeros((0, *first.shape))


def _turned_and_stretched(
    equation: AsRigid, ends: Float[np.ndarray, "2 V 2"]
) -> tuple[Float[np.ndarray, "2 F"], Float[np.ndarray, "2 F 2 2"]]:
    """Split each triangle's Jacobian into an angle, near its part's, and a symmetric stretch."""
    tree = equation.tree
    jacobians = np.stack([(equation.gradient @ end).reshape(-1, 2, 2) for end in ends])
    jacobians = np.swapaxes(jacobians, -1, -2)
    angles = affine.turn_of(jacobians)
    parts = turns_of(tree, unwound(bones_of(tree, ends)))[:, tree.puppet.layer_of_triangle]
    angles = parts + wrapped(angles - parts)
    return angles, np.swapaxes(_rotations(angles), -1, -2) @ jacobians


def _rotations(angles: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 2 2"]:
    cos, sin = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)


def _gradient_rows(
    inverses: Float[np.ndarray, "F 2 2"], triangles: Int[np.ndarray, "F 3"], count: int
) -> sparse.csr_array:
    """Rows 2f and 2f + 1: a coordinate's slope along x and y at rest, from the three corners' values."""
    last = inverses.transpose(0, 2, 1)
    weights = np.concatenate([-last.sum(-1, keepdims=True), last], -1)
    rows = np.repeat(np.arange(2 * len(triangles)), 3)
    columns = np.repeat(triangles, 2, axis=0).reshape(-1)
    return sparse.csr_array((weights.reshape(-1), (rows, columns)), shape=(2 * len(triangles), count))


def _joint_rows(tree: BoneTree) -> sparse.csr_array:
    """Row j: how far joint j's second point is from its first, from the corners' values."""
    puppet = tree.puppet
    count = len(puppet.joint_layers)
    weights = np.concatenate([-puppet.joint_weights[:, 0], puppet.joint_weights[:, 1]], 1).reshape(-1)
    columns = np.concatenate([puppet.joint_vertices[:, 0], puppet.joint_vertices[:, 1]], 1).reshape(-1)
    shape = (count, len(puppet.vertices))
    return sparse.csr_array((weights, (np.repeat(np.arange(count), 6), columns)), shape=shape)
