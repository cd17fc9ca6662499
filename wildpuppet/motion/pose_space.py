"""A decoder made of known poses, without training: codes are hinge rotations, sizes, gaps and bends in one row.

It decodes every pose that it was made of exactly, and mixes of codes turn parts about their hinges instead of shrinking
them (``motion/bones.py``). In contrast to a network it has no picture to read: it serves where poses are at hand, as in
a finished run.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.motion.bones import Bones, BoneTree, bone_tree_of, bones_of, wrapped
from wildpuppet.types import Puppet


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """The decoder of one puppet; build with ``pose_space_of``.

    ``is_above[l, m]``: part m is l or an ancestor of l. ``at`` is each part's hinge at rest (the root's middle).
    """

    tree: BoneTree
    is_above: Float[np.ndarray, "L L"]
    parent: tuple[int, ...]
    at: Float[np.ndarray, "L 2"]

    def encode(
        self, vertices: Float[np.ndarray, "T V 2"], like: Float[np.ndarray, "V 2"] | None = None
    ) -> Float[np.ndarray, "T Z"]:
        """Find the codes of poses. Parts turn the short way from the pose ``like``."""
        bones = bones_of(self.tree, vertices)
        if like is not None:
            near = bones_of(self.tree, like[None]).turns
            bones = replace(bones, turns=near + wrapped(bones.turns - near))
        return _row(bones)

    def decode_tensor(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes; differentiable."""
        count, puppet = len(self.at), self.tree.puppet
        places, turns, logs, gaps, bends = torch.split(
            codes, [2, count, count, 2 * count, 2 * len(puppet.vertices)], dim=1
        )
        above, at = (torch.from_numpy(array).to(codes) for array in (self.is_above, self.at))
        layer = torch.from_numpy(np.array(puppet.layer_of_vertex)).long()
        size, angle = (logs @ above.T).exp(), turns @ above.T
        map_of_part = torch.stack([size * angle.cos(), size * angle.sin()], -1)
        map_of_parent = map_of_part[:, list(self.parent)]
        is_root = torch.tensor([parent == part for part, parent in enumerate(self.parent)])[:, None]
        hung = times(map_of_parent, at + gaps.reshape(-1, count, 2)) - times(map_of_part, at)
        hung = torch.where(is_root, places[:, None] - times(map_of_part, at), hung)
        shift = torch.einsum("lm,bmc->blc", above, hung)
        shaped = torch.from_numpy(np.array(puppet.vertices)).to(codes) + bends.reshape(len(codes), -1, 2)
        return times(map_of_part[:, layer], shaped) + shift[:, layer]

    def turnings(self) -> Float[np.ndarray, "L Z"]:
        """Give the directions in which one part turns (and what hangs from it), by one radian."""
        count = len(self.at)
        directions = np.zeros((count, 2 + 4 * count + 2 * len(self.tree.puppet.vertices)))
        directions[np.arange(count), 2 + np.arange(count)] = 1.0
        return directions


def pose_space_of(puppet: Puppet) -> PoseSpace:
    """Prepare a puppet's decoder."""
    tree = bone_tree_of(puppet)
    above, at = np.eye(puppet.num_layers), np.zeros((puppet.num_layers, 2))
    parent = np.arange(puppet.num_layers)
    at[tree.root] = tree.middle
    for edge in tree.edges:
        above[edge.child] += above[edge.parent]
        at[edge.child], parent[edge.child] = edge.at, edge.parent
    return PoseSpace(tree, above, tuple(parent.tolist()), at)


def times(a: Float[Tensor, "*n 2"], b: Float[Tensor, "*#n 2"]) -> Float[Tensor, "*n 2"]:
    """Multiply complex numbers."""
    real = a[..., 0] * b[..., 0] - a[..., 1] * b[..., 1]
    return torch.stack([real, a[..., 0] * b[..., 1] + a[..., 1] * b[..., 0]], -1)


def _row(bones: Bones) -> Float[np.ndarray, "T Z"]:
    """Write bones as one row per pose."""
    parts = (bones.places, bones.turns, bones.log_scales, bones.gaps, bones.bends)
    return np.concatenate([part.reshape(len(bones), -1) for part in parts], 1)
