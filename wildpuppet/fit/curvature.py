"""How curved the energy is, roughly, at rest: the preconditioners of the descent.

Two levels, added: each part as a whole (shift, turn, scale; its hinges as springs), and the mesh (data curvature on
the diagonal, ARAP's stiffness, hinges). Whole limbs then move in a few steps where plain descent on vertices crawls
(Nicolet, Jacobson and Jakob, "Large Steps in Inverse Rendering", 2021, for the idea of descending in a smoothed
metric). Data curvature is Gauss-Newton's, from the texture's own gradient, lumped to the nearest vertex.
"""

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree
from torch import Tensor

from wildpuppet.render.texture import Texture
from wildpuppet.types import Puppet

SILHOUETTE_CONTRAST = 60.0
"""Grey levels by which a character is assumed to differ from what is behind it."""


def data_curvature(puppet: Puppet, texture: Texture) -> Float[np.ndarray, "V"]:
    """Sum each vertex's share of the squared texture gradient (per axis), in squared grey levels."""
    rgba = texture.rgba.numpy().astype(np.float64) * np.array([255.0, 255.0, 255.0, SILHOUETTE_CONTRAST])
    down, right = np.gradient(rgba, axis=(0, 1))
    energy = ((down**2).sum(-1) + (right**2).sum(-1)) / 2
    rows, columns = np.nonzero(energy > 0)
    uv = texture.uv.numpy()
    _, nearest = cKDTree(uv).query(np.stack([columns + 0.5, rows + 0.5], -1))
    return np.bincount(nearest, energy[rows, columns], len(uv)).astype(np.float64)  # counts where nothing slopes


def stiffness_matrix(puppet: Puppet) -> Float[np.ndarray, "V V"]:
    """Assemble the mesh's Laplacian in finite elements (integral of grad_i . grad_j); independent of scale."""
    corners = puppet.vertices[puppet.triangles]
    edges = np.roll(corners, -2, 1) - np.roll(corners, -1, 1)
    doubled = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    local = np.einsum("fik,fjk->fij", edges, edges) / (2 * np.maximum(doubled, 1e-9))[:, None, None]
    rows = np.repeat(puppet.triangles, 3, 1).ravel()
    columns = np.tile(puppet.triangles, (1, 3)).ravel()
    size = len(puppet.vertices)
    matrix: Float[np.ndarray, "V V"] = coo_matrix((local.ravel(), (rows, columns)), (size, size)).toarray()
    return matrix


def joint_matrix(puppet: Puppet) -> Float[np.ndarray, "V V"]:
    """Assemble the quadratic form of sum_j |p_j - q_j|^2 over one coordinate."""
    rows = np.zeros((len(puppet.joint_layers), len(puppet.vertices)))
    for j in range(len(rows)):
        np.add.at(rows[j], puppet.joint_vertices[j, 0], puppet.joint_weights[j, 0])
        np.add.at(rows[j], puppet.joint_vertices[j, 1], -puppet.joint_weights[j, 1])
    matrix: Float[np.ndarray, "V V"] = rows.T @ rows
    return matrix


def mesh_inverse(
    data: Float[np.ndarray, "V"], stiffness: Float[np.ndarray, "V V"], joints: Float[np.ndarray, "V V"]
) -> Float[Tensor, "V V"]:
    """Invert data + stiffness + joints; vertices without data get a small floor."""
    diagonal = data + 0.02 * data.mean() + 1e-9
    inverse = np.linalg.inv(np.diag(diagonal) + stiffness + joints)
    return torch.from_numpy(inverse.astype(np.float32))


class Bones:
    """Groups of vertices that move as wholes: (shift x, shift y, turn, scale) per group, lengths in pixels.

    Turn and scale are measured at the group's radius, so that all four are pixels.
    """

    def __init__(self, group_of_vertex: Int[np.ndarray, "V"], puppet: Puppet, hold_scale: float) -> None:
        self.group = torch.from_numpy(group_of_vertex.astype(np.int64))
        self.num = int(group_of_vertex.max()) + 1
        self.joint_vertices = torch.from_numpy(puppet.joint_vertices.astype(np.int64))
        self.joint_weights = torch.from_numpy(puppet.joint_weights.astype(np.float32))
        self.count = torch.bincount(self.group, minlength=self.num).float().clamp_min(1)
        self.hold_scale = hold_scale

    def basis(self, vertices: Float[Tensor, "B V 2"]) -> Float[Tensor, "B V 2 4"]:
        """Derivative of each vertex with respect to its group's four parameters."""
        batch = len(vertices)
        sums = torch.zeros(batch, self.num, 2).index_add(1, self.group, vertices)
        arm = vertices - (sums / self.count[:, None])[:, self.group]
        squares = torch.zeros(batch, self.num).index_add(1, self.group, (arm**2).sum(-1))
        arm = arm / (squares / self.count).sqrt().clamp_min(1.0)[:, self.group, None]
        one, zero = torch.ones_like(arm[..., 0]), torch.zeros_like(arm[..., 0])
        along_x = torch.stack([one, zero, -arm[..., 1], arm[..., 0]], -1)
        along_y = torch.stack([zero, one, arm[..., 0], arm[..., 1]], -1)
        return torch.stack([along_x, along_y], -2)

    def step(
        self, vertices: Float[Tensor, "B V 2"], gradient: Float[Tensor, "B V 2"], data: Float[Tensor, "V"],
        joint_weight: float, damping: Float[Tensor, "B"],
    ) -> Float[Tensor, "B V 2"]:  # fmt: skip
        """Take the Gauss-Newton step of the groups; ``data`` is each vertex's curvature per axis."""
        batch, size = len(vertices), 4 * self.num
        basis = self.basis(vertices)
        reduced = torch.zeros(batch, self.num, 4).index_add(1, self.group, (basis * gradient[..., None]).sum(2))
        blocks = (basis[..., :, None] * basis[..., None, :]).sum(2) * data[:, None, None]
        blocks = torch.zeros(batch, self.num, 4, 4).index_add(1, self.group, blocks)
        trace = blocks.diagonal(dim1=-2, dim2=-1).mean(-1)
        floor = 0.01 * trace.mean(-1, keepdim=True) + damping[:, None] * trace + 1e-9
        matrix = torch.zeros(batch, self.num, 4, self.num, 4)
        index = torch.arange(self.num)
        matrix[:, index, :, index] = (blocks + torch.diag_embed(floor[..., None].expand(-1, -1, 4))).transpose(0, 1)
        matrix[:, index, 3, index, 3] += self.hold_scale * trace.mean(-1, keepdim=True)
        matrix = matrix.reshape(batch, size, size) + joint_weight * self._joint_form(basis, size)
        solved = torch.linalg.solve(matrix, reduced.reshape(batch, size)).reshape(batch, self.num, 4)
        step: Float[Tensor, "B V 2"] = -(basis * solved[:, self.group, None]).sum(-1)
        return step

    def _joint_form(self, basis: Float[Tensor, "B V 2 4"], size: int) -> Float[Tensor, "B S S"]:
        batch, num_joints = len(basis), len(self.joint_vertices)
        rows = torch.zeros(batch, num_joints, 2, self.num, 4)
        for side, sign in ((0, 1.0), (1, -1.0)):
            corners = self.joint_vertices[:, side]
            moved = (basis[:, corners] * self.joint_weights[:, side, :, None, None]).sum(2) * sign
            groups = self.group[corners[:, 0]]
            rows[:, torch.arange(num_joints), :, groups] += moved.transpose(0, 1)
        flat = rows.reshape(batch, num_joints * 2, size)
        return flat.transpose(1, 2) @ flat
