"""Coarse-to-fine descent on the energy with the exact gradient, a batch of frames at a time.

    E = rec / N + arap * E_arap + joints * E_joints + area * E_area        (METHOD section 1; units of section 2)

rec sums, over pixels, the robust squared difference of frame and puppet under the puppet's mask (Geman and McClure's
rho) and the price of covering or not covering; N is the mask's size at the start. Each frame
keeps a step length of its own: a step that raises its energy is taken back and halved.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from wildpuppet.fit import curvature, energy
from wildpuppet.fit.data import data_term
from wildpuppet.fit.pins import Pins
from wildpuppet.fit.target import Target, texture_for
from wildpuppet.geometry.arap import ArapRest, arap_energy_and_gradient, arap_rest, best_scale_of
from wildpuppet.pose.tree import part_areas
from wildpuppet.render.render import Mesh, Texture, mesh_of, render
from wildpuppet.settings import FitSettings
from wildpuppet.types import Puppet

SIZE_STEP = 1.02
"""Ratio between the sizes at which textures are kept."""
VISIBLE_SHARE = 0.75
"""Share of the parts' areas that is seen, roughly: the rest is overlap."""
SCALE_SLACK = 1.05
"""How far a level may change a frame's size freely; beyond, ARAP holds it."""
LOSS_NAMES = ("reconstruction", "coverage", "arap", "joints", "area")


class Seen(NamedTuple):
    """A puppet at a size: ``texture`` at ``SIZE_STEP ** step`` and ``data``, its curvature per pixel of mask."""

    step: int
    texture: Texture
    data: Float[np.ndarray, "V"]


@lru_cache(maxsize=12)
def seen_at(puppet: Puppet, step: int) -> Seen:
    """Make the texture of a size and the data term's curvature, once for all batches of about that size."""
    scale = SIZE_STEP**step
    texture = texture_for(puppet, scale)
    mask_pixels = VISIBLE_SHARE * float(part_areas(puppet).sum()) * scale**2
    return Seen(step, texture, curvature.data_curvature(puppet, texture) * (2.0 / 3.0 / max(mask_pixels, 1.0)))


@lru_cache(maxsize=12)
def _mesh_inverse(puppet: Puppet, step: int, weight: float, stiffness: float, joints: float) -> Float[Tensor, "V V"]:
    """Invert the mesh's curvature, each term in its weight."""
    stiff, tied = curvature.stiffness_matrix(puppet), curvature.joint_matrix(puppet)
    return curvature.mesh_inverse(weight * seen_at(puppet, step).data, stiffness * stiff, joints * tied)


@dataclass(frozen=True, eq=False)
class Problem:
    """One level's energy: everything that does not change while vertices move. Coordinates are level pixels."""

    puppet: Puppet
    mesh: Mesh
    seen: Seen
    target: Target
    order: Int[Tensor, "B L"]
    rest: ArapRest
    settings: FitSettings
    mask_pixels: Float[Tensor, "B"]
    scale: Float[Tensor, "B"]

    @property
    def texture(self) -> Texture:
        """The puppet's texture at about this level's size."""
        return self.seen.texture

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) of the level."""
        return self.target.colour.shape[2], self.target.colour.shape[1]

    @property
    def unit(self) -> float:
        """[-1, 1] units per level pixel."""
        return 2.0 / max(self.size)


def make_problem(
    puppet: Puppet, target: Target, order: Int[np.ndarray, "B L"], vertices: Float[Tensor, "B V 2"],
    settings: FitSettings,
) -> Problem:  # fmt: skip
    """Prepare a level; ``vertices`` (level pixels) say how large the puppet is seen and its mask at the start."""
    rest = arap_rest(puppet.vertices.astype(np.float32), puppet.triangles)
    scale = best_scale_of(vertices.numpy(), rest)
    mesh, seen = mesh_of(puppet), seen_at(puppet, round(math.log(float(np.median(scale))) / math.log(SIZE_STEP)))
    orders = torch.from_numpy(np.array(order))
    size = (target.colour.shape[2], target.colour.shape[1])
    with torch.no_grad():
        mask = render(vertices, mesh, seen.texture, orders, size).rgba[..., 3].sum((1, 2)).clamp_min(16.0)
    return Problem(puppet, mesh, seen, target, orders, rest, settings, mask, torch.from_numpy(scale).float())


def energies(
    problem: Problem, vertices: Float[Tensor, "B V 2"]
) -> tuple[Float[Tensor, "B"], Float[Tensor, "B V 2"], dict[str, Float[Tensor, "B"]]]:
    """Compute the whole energy per frame, its gradient and each term before weighting."""
    settings = problem.settings
    moving = vertices.detach().requires_grad_()
    image = render(moving, problem.mesh, problem.texture, problem.order, problem.size).rgba
    target, limit = problem.target, settings.robust**2
    reconstruction, coverage = (
        total / problem.mask_pixels for total in data_term(image, target.colour, target.cover_gain, limit)
    )
    joints = energy.joint_distance(moving * problem.unit, *_joints(problem.puppet), slack=settings.joint_slack)
    with torch.no_grad():
        free = torch.from_numpy(best_scale_of(vertices.numpy(), problem.rest).astype(np.float32))
        scale = free.clamp(problem.scale / SCALE_SLACK, problem.scale * SCALE_SLACK)
        expected = torch.from_numpy(problem.puppet.vertices.astype(np.float32))[None] * scale[:, None, None]
    layer_of_triangle = torch.from_numpy(problem.puppet.layer_of_triangle.astype(np.int64))
    triangles = torch.from_numpy(problem.puppet.triangles.astype(np.int64))
    area = energy.layer_area(moving, expected, triangles, layer_of_triangle)
    per_frame = settings.reconstruction * (reconstruction + coverage) + settings.joints * joints
    per_frame = per_frame + settings.area * area * target.level**-4
    (gradient,) = torch.autograd.grad(per_frame.sum(), moving)
    stiff, stiff_gradient = arap_energy_and_gradient(vertices.numpy(), problem.rest, scale.numpy())
    arap = torch.from_numpy(stiff) * problem.unit**2
    gradient = gradient + settings.arap * problem.unit**2 * torch.from_numpy(stiff_gradient)
    terms = {
        "reconstruction": reconstruction.detach(), "coverage": coverage.detach(), "arap": arap,
        "joints": joints.detach(), "area": area.detach() * target.level**-4,
    }  # fmt: skip
    return per_frame.detach() + settings.arap * arap, gradient, terms


def descend(
    problem: Problem,
    vertices: Float[Tensor, "B V 2"],
    steps: int,
    bones: curvature.Bones,
    with_mesh: bool,
    pins: Pins | None = None,
) -> Float[Tensor, "B V 2"]:
    """Take ``steps`` preconditioned steps: bones alone, or bones and mesh together. ``pins`` stay where they are."""
    if steps == 0:
        return vertices
    settings = problem.settings
    joint_weight, stiffness = (2 * weight * problem.unit**2 for weight in (settings.joints, settings.arap))
    inverse = None
    if with_mesh:
        inverse = _mesh_inverse(problem.puppet, problem.seen.step, settings.reconstruction, stiffness, joint_weight)
    data_of_vertex = torch.from_numpy((settings.reconstruction * problem.seen.data).astype(np.float32))
    length = torch.ones(len(vertices))
    value, gradient, _ = energies(problem, vertices)
    for step in range(steps):
        if inverse is None or step % 3 == 0:
            move = bones.step(vertices, gradient, data_of_vertex, joint_weight, (1 / length).clamp_min(1.0) - 1.0)
        else:
            move = -torch.einsum("vw,bwk->bvk", inverse, gradient)
        if pins is not None:
            move = pins.step(move)
        longest = move.norm(dim=-1).amax(1).clamp_min(1e-6)
        limit = (0.04 * max(problem.size) / longest).clamp_max(1.0)
        tried = vertices + (length * limit)[:, None, None] * move
        new_value, new_gradient, _ = energies(problem, tried)
        better = new_value < value
        vertices = torch.where(better[:, None, None], tried, vertices)
        gradient = torch.where(better[:, None, None], new_gradient, gradient)
        value = torch.where(better, new_value, value)
        length = torch.where(better, (length * 1.4).clamp_max(1.5), length * 0.4).clamp_min(0.02)
    return vertices


def _joints(puppet: Puppet) -> tuple[Int[Tensor, "J 2 3"], Float[Tensor, "J 2 3"]]:
    return torch.from_numpy(puppet.joint_vertices.astype(np.int64)), torch.from_numpy(
        puppet.joint_weights.astype(np.float32)
    )
