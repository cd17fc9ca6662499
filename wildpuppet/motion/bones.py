"""Poses as hinge rotations: what interpolation and retargeting work on.

Along the tree of joints every part is a similarity of its rest shape. It is kept relative to its parent: the turn and
the scale against the parent's, and how far its hinge stands from where the parent has it. What is left is the mesh's
own bend, kept in the part's rest frame. All of it together is exact: ``posed(tree, bones_of(tree, v)) == v``.

Angles are in radians (x towards y, so clockwise on screen), lengths relative to a parent in canvas pixels at rest. The
root's place is where its middle stands, in the pixels of the vertices.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.pose.similarity import similarities
from wildpuppet.pose.tree import Edge, tree_of
from wildpuppet.types import Puppet

LEAST_SCALE = 1e-6
"""A part that a fit shrank to a point still has a scale, so that its logarithm is a number."""


@dataclass(frozen=True, eq=False)
class BoneTree:
    """A puppet's tree of parts. ``edges`` from the root outwards; ``middle`` the root's middle at rest."""

    puppet: Puppet
    root: int
    edges: tuple[Edge, ...]
    middle: Float[np.ndarray, "2"]

    @property
    def parents(self) -> dict[int, int]:
        """Parent of each layer but the root's."""
        return {edge.child: edge.parent for edge in self.edges}


@dataclass(frozen=True, eq=False)
class Bones:
    """Poses of one puppet; the entries of the root are its own turn and scale and (unused) a zero gap.

    ``turns[t, l]`` and ``log_scales[t, l]`` are against the parent; ``gaps[t, l]`` is how far the child's hinge stands
    from the parent's, in the parent's rest frame; ``bends[t, v]`` is what the part's similarity leaves, in the part's
    rest frame; ``places[t]`` is where the root's middle is.
    """

    places: Float[np.ndarray, "T 2"]
    turns: Float[np.ndarray, "T L"]
    log_scales: Float[np.ndarray, "T L"]
    gaps: Float[np.ndarray, "T L 2"]
    bends: Float[np.ndarray, "T V 2"]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: slice | Int[np.ndarray, "n"] | list[int]) -> "Bones":
        """Choose poses."""
        return Bones(*(getattr(self, field.name)[index] for field in fields(self)))


def bone_tree_of(puppet: Puppet) -> BoneTree:
    """Hang the puppet's parts on a tree over its joints."""
    tree = tree_of(puppet)
    middle = puppet.vertices[puppet.layer_of_vertex == tree.root].astype(np.float64).mean(0)
    return BoneTree(puppet, tree.root, tree.edges, middle)


def bones_of(tree: BoneTree, vertices: Float[np.ndarray, "T V 2"]) -> Bones:
    """Read the bones off posed vertices.

    Turns against the parent are within half a turn of rest; ``unwound`` makes them continuous over a sequence.
    """
    puppet = tree.puppet
    maps = similarities(puppet, vertices)
    turns, logs = np.arctan2(maps[..., 1, 0], maps[..., 0, 0]), np.log(np.maximum(_sizes(maps), LEAST_SCALE))
    relative, ratios, gaps = turns.copy(), logs.copy(), np.zeros((*turns.shape, 2))
    for edge in tree.edges:
        relative[:, edge.child] = wrapped(turns[:, edge.child] - turns[:, edge.parent])
        ratios[:, edge.child] = logs[:, edge.child] - logs[:, edge.parent]
        at = np.array(edge.at)
        hinge = maps[:, edge.child, :, :2] @ at + maps[:, edge.child, :, 2]
        gaps[:, edge.child] = _undone(maps[:, edge.parent], hinge) - at
    mine = maps[:, puppet.layer_of_vertex]
    bends = _undone(mine, vertices.astype(np.float64)) - puppet.vertices
    root = maps[:, tree.root]
    return Bones(root[..., :2] @ tree.middle + root[..., 2], relative, ratios, gaps, bends)


def posed(tree: BoneTree, bones: Bones) -> Float[np.ndarray, "T V 2"]:
    """Pose the puppet by bones."""
    puppet = tree.puppet
    maps = maps_of(tree, bones)[:, puppet.layer_of_vertex]
    shaped = puppet.vertices + bones.bends
    moved: Float[np.ndarray, "T V 2"] = (maps[..., :2] @ shaped[..., None])[..., 0] + maps[..., 2]
    return moved


def maps_of(tree: BoneTree, bones: Bones) -> Float[np.ndarray, "T L 2 3"]:
    """Give each part's similarity from the canvas at rest to the bones' pixels."""
    turns, logs = turns_of(tree, bones), bones.log_scales.copy()
    maps = np.zeros((*turns.shape, 2, 3))
    root = tree.root
    maps[:, root] = _turned(turns[:, root], logs[:, root], tree.middle, bones.places)
    for edge in tree.edges:
        logs[:, edge.child] += logs[:, edge.parent]
        at, parent = np.array(edge.at), maps[:, edge.parent]
        hinge = (parent[..., :2] @ (at + bones.gaps[:, edge.child])[..., None])[..., 0] + parent[..., 2]
        maps[:, edge.child] = _turned(turns[:, edge.child], logs[:, edge.child], at, hinge)
    return maps


def turns_of(tree: BoneTree, bones: Bones) -> Float[np.ndarray, "T L"]:
    """Add up each part's turn from the root: its angle against rest."""
    turns = bones.turns.copy()
    for edge in tree.edges:
        turns[:, edge.child] += turns[:, edge.parent]
    return turns


def unwound(bones: Bones) -> Bones:
    """Make every turn continue the one before, the short way around."""
    return replace(bones, turns=np.unwrap(bones.turns, axis=0))


def wrapped(radians: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Bring angles into [-pi, pi)."""
    return np.asarray((radians + np.pi) % (2 * np.pi) - np.pi)


def _turned(
    turn: Float[np.ndarray, "T"],
    log_scale: Float[np.ndarray, "T"],
    rest: Float[np.ndarray, "2"],
    place: Float[np.ndarray, "T 2"],
) -> Float[np.ndarray, "T 2 3"]:
    """Build the similarities that turn and scale and take ``rest`` to ``place``."""
    cos, sin = np.exp(log_scale) * np.cos(turn), np.exp(log_scale) * np.sin(turn)
    linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    return np.concatenate([linear, (place - linear @ rest)[..., None]], -1)


def _undone(
    maps: Float[np.ndarray, "*batch 2 3"], points: Float[np.ndarray, "*batch 2"]
) -> Float[np.ndarray, "*batch 2"]:
    """Take points back through similarities."""
    moved = points - maps[..., 2]
    linear = maps[..., :2] / np.maximum(_sizes(maps)[..., None, None] ** 2, LEAST_SCALE**2)
    return np.asarray((np.swapaxes(linear, -1, -2) @ moved[..., None])[..., 0])


def _sizes(maps: Float[np.ndarray, "*batch 2 3"]) -> Float[np.ndarray, "*batch"]:
    return np.asarray(np.hypot(maps[..., 0, 0], maps[..., 1, 0]))
