"""Pins: points of the puppet that must stay where a person put them while the descent moves everything else.

Every step of the descent is made to leave the pinned points where they are: what it would move them by is taken back
by the smoothest displacement of their parts (a Green's function of the mesh's Laplacian). A part with one pin turns
about it, one with two keeps its place, and bends where the picture asks for it. Frames with all vertices pinned do not
move at all.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.fit.curvature import stiffness_matrix
from wildpuppet.types import Keyframe, Puppet

# How little a displacement costs beside its bending: parts move as wholes almost for nothing.
WHOLE_SHARE = 1e-4
# Points this close to saying the same thing twice are averaged.
SAME_POINT = 1e-6


@dataclass(frozen=True, eq=False)
class Pins:
    """The pins of each frame of a batch: V x V maps, ``allowed`` of a step to what leaves the pins in place."""

    allowed: Float[Tensor, "B V V"]

    def step(self, move: Float[Tensor, "B V 2"]) -> Float[Tensor, "B V 2"]:
        """Take back what would move a pinned point."""
        return torch.einsum("bvw,bwk->bvk", self.allowed, move)


def pins_of(puppet: Puppet, keyframes: list[Keyframe | None]) -> Pins | None:
    """Prepare the pins of a batch; None stands for a frame without any. None where no frame has."""
    if all(keyframe is None for keyframe in keyframes):
        return None
    free = np.eye(len(puppet.vertices))
    allowed = [free if keyframe is None else _allowed(puppet, keyframe) for keyframe in keyframes]
    return Pins(torch.from_numpy(np.stack(allowed).astype(np.float32)))


def pinned_vertices(
    puppet: Puppet,
    keyframe: Keyframe,
    crop_from_video: Float[np.ndarray, "2 3"],
    vertices: Float[np.ndarray, "*B V 2"],
) -> Float[np.ndarray, "*B V 2"]:
    """Bend poses, crop pixels, as little as can be so that pinned points stand where they were put."""
    linear, offset = crop_from_video[:, :2], crop_from_video[:, 2]
    if keyframe.vertices_video is not None:
        return np.broadcast_to(keyframe.vertices_video @ linear.T + offset, vertices.shape).copy()
    points, spread = _points(puppet, keyframe), _spread(puppet, keyframe)
    missing = keyframe.points_video @ linear.T + offset - points @ vertices
    moved: Float[np.ndarray, "*B V 2"] = vertices + spread @ missing
    return moved


def _points(puppet: Puppet, keyframe: Keyframe) -> Float[np.ndarray, "n V"]:
    rows = np.zeros((len(keyframe.corners), len(puppet.vertices)))
    for row, corners, weights in zip(rows, keyframe.corners, keyframe.weights, strict=True):
        np.add.at(row, corners, weights)
    return rows


def _spread(puppet: Puppet, keyframe: Keyframe) -> Float[np.ndarray, "V n"]:
    """Displace the vertices for a unit displacement of each point, smoothly and within the point's part."""
    points, stiffness = _points(puppet, keyframe), stiffness_matrix(puppet)
    floor = WHOLE_SHARE * np.trace(stiffness) / len(stiffness)
    answers = np.linalg.solve(stiffness + floor * np.eye(len(stiffness)), points.T)
    spread: Float[np.ndarray, "V n"] = answers @ np.linalg.pinv(points @ answers, rcond=SAME_POINT)
    return spread


def _allowed(puppet: Puppet, keyframe: Keyframe) -> Float[np.ndarray, "V V"]:
    size = len(puppet.vertices)
    if keyframe.vertices_video is not None:
        return np.zeros((size, size))
    allowed: Float[np.ndarray, "V V"] = np.eye(size) - _spread(puppet, keyframe) @ _points(puppet, keyframe)
    return allowed
