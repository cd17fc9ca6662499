"""As-rigid-as-possible: how far a posed mesh is from turned and shifted pieces of its rest shape.

Two energies over triangles f with areas A_f and Jacobians J (rest to posed), cells i with neighbours N(i):

- ours: sum_f A_f min_R |J - R|^2. In the plane no SVD is needed (METHOD: |J|^2 + 2 - 2 |s|). With
  s = (J00 + J11, J10 - J01) the part of J that turns and scales, d = (J00 - J11, J10 + J01) the part that shears,
  it is A_f / 2 ((|s| - 2)^2 + |d|^2), a sum of squares that cannot go below zero by rounding.
- the paper's (Neural Puppet, section 3.2; Sorkine and Alexa 2007), with cotangent weights:
  sum_i sum_{j in N(i)} w_ij |(v'_i - v'_j) - R_i (v_i - v_j)|^2.
  It visits every edge from both ends, so on a uniform deformation it is twice ours.

``scale`` multiplies the rest shape, so that a puppet seen at 0.6 of its size is not a deformation. Energies are in
the squared units of the vertices. A triangle without area at rest counts for nothing. Energies are sums, not means.
Where s is 0 (a triangle turned inside out) the best rotation is undetermined and the gradient takes |s|'s as 0.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.linalg import vector_norm

from wildpuppet.geometry.arap_kernel import add_triangles

LEAST_AREA_SHARE = 1e-9
"""A triangle smaller than this share of the mesh's squared extent has no usable Jacobian and weighs nothing."""


@dataclass(frozen=True, eq=False)
class ArapRest:
    """What the fast energy needs of the rest shape; build with ``arap_rest``.

    ``inverses[f]`` takes posed edges to the Jacobian, J = [b - a, c - a] @ inverse; zero where the area is zero.
    """

    triangles: Int[np.ndarray, "F 3"]
    inverses: Float[np.ndarray, "F 2 2"]
    areas: Float[np.ndarray, "F"]
    num_vertices: int


def arap_rest(
    rest: Float[np.ndarray, "V 2"],
    triangles: Int[np.ndarray, "F 3"],
    stiffness: Float[np.ndarray, "F"] | None = None,
) -> ArapRest:
    """Prepare a rest shape; ``stiffness`` multiplies the triangles' areas (1 everywhere if left out).

    The fast functions work in ``rest``'s dtype.
    """
    corners = torch.from_numpy(np.array(rest))[torch.from_numpy(np.array(triangles, dtype=np.int64))]
    inverses, areas = _rest_frames(corners)
    weights = areas.numpy() if stiffness is None else (areas.numpy() * stiffness).astype(rest.dtype)
    return ArapRest(np.ascontiguousarray(triangles, dtype=np.int32), inverses.numpy(), weights, len(rest))


def arap_energy(
    vertices: Float[Tensor, "B V 2"],
    rest: Float[Tensor, "V 2"],
    triangles: Int[Tensor, "F 3"],
    scale: Float[Tensor, "B"] | None = None,
) -> Float[Tensor, "B"]:
    """Compute the energy over triangles; differentiable in ``vertices`` and ``scale``."""
    inverses, areas = _rest_frames(rest[triangles])
    similar, sheared = _split(_edges(vertices[:, triangles]) @ inverses)
    target = 2.0 if scale is None else 2.0 * scale[:, None]
    length: Tensor = vector_norm(similar, dim=-1)
    return (0.5 * areas * ((length - target) ** 2 + (sheared**2).sum(-1))).sum(-1)


def best_scale(
    vertices: Float[Tensor, "B V 2"], rest: Float[Tensor, "V 2"], triangles: Int[Tensor, "F 3"]
) -> Float[Tensor, "B"]:
    """Find the scale of the rest shape with the least energy: the area-weighted mean of |s| / 2.

    As it is the minimum, the energy's gradient at a detached best scale is the gradient of the scale-free energy.
    """
    inverses, areas = _rest_frames(rest[triangles])
    similar, _ = _split(_edges(vertices[:, triangles]) @ inverses)
    total = areas.sum().clamp_min(torch.finfo(areas.dtype).tiny)
    length: Tensor = vector_norm(similar, dim=-1)
    return 0.5 * (length * areas).sum(-1) / total


def arap_energy_and_gradient(
    vertices: Float[np.ndarray, "B V 2"], rest: ArapRest, scale: Float[np.ndarray, "B"] | None = None
) -> tuple[Float[np.ndarray, "B"], Float[np.ndarray, "B V 2"]]:
    """Compute the energy over triangles and its gradient on one CPU thread; the same numbers as ``arap_energy``."""
    if vertices.shape[1] != rest.num_vertices:
        raise ValueError(f"expected {rest.num_vertices} vertices, found {vertices.shape[1]}")
    kind = rest.inverses.dtype
    scales = np.ones(len(vertices), kind) if scale is None else np.ascontiguousarray(scale, dtype=kind)
    energy, gradient = np.zeros(len(vertices), kind), np.zeros(vertices.shape, kind)
    posed = np.ascontiguousarray(vertices, dtype=kind)
    add_triangles(posed, rest.triangles, rest.inverses, rest.areas, scales, energy, gradient)
    return energy, gradient


def best_scale_of(vertices: Float[np.ndarray, "B V 2"], rest: ArapRest) -> Float[np.ndarray, "B"]:
    """Find the scale of the rest shape with the least energy; as ``best_scale``, in numpy."""
    corners = vertices[:, rest.triangles]
    edges = np.stack([corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]], -1)
    jacobians = edges @ rest.inverses
    length = np.hypot(jacobians[..., 0, 0] + jacobians[..., 1, 1], jacobians[..., 1, 0] - jacobians[..., 0, 1])
    total = max(float(rest.areas.sum()), float(np.finfo(rest.areas.dtype).tiny))
    return np.asarray(0.5 * (length @ rest.areas) / total)


def cell_energy(
    vertices: Float[Tensor, "B V 2"],
    rest: Float[Tensor, "V 2"],
    triangles: Int[Tensor, "F 3"],
    scale: Float[Tensor, "B"] | None = None,
) -> Float[Tensor, "B"]:
    """Compute the paper's energy as printed: one best rotation per vertex cell, cotangent weights.

    Edges as complex numbers e (rest) and e' (posed): the best rotation of cell i turns by the angle of
    c_i = sum_j w_ij e'_ij conj(e_ij), and leaves sum_j w_ij (|e'_ij|^2 + |e_ij|^2) - 2 |c_i|. An edge whose weight
    would be negative (across obtuse angles) weighs 0: with it the best rotation could be the worst one.
    """
    starts, ends, weights = _directed_edges(rest, triangles)
    before = (rest[starts] - rest[ends]) * (1.0 if scale is None else scale[:, None, None])
    after = vertices[:, starts] - vertices[:, ends]
    real = weights * (after * before).sum(-1)
    imaginary = weights * (after[..., 1] * before[..., 0] - after[..., 0] * before[..., 1])
    sums = torch.zeros_like(vertices).index_add(1, starts, torch.stack([real, imaginary], -1))
    squares = (weights * ((after**2).sum(-1) + (before**2).sum(-1))).sum(-1)
    length: Tensor = vector_norm(sums, dim=-1)
    return squares - 2.0 * length.sum(-1)


def _edges(corners: Float[Tensor, "*batch 3 2"]) -> Float[Tensor, "*batch 2 2"]:
    """Two edges from the first corner, as columns."""
    return (corners[..., 1:, :] - corners[..., :1, :]).transpose(-1, -2)


def _split(jacobians: Float[Tensor, "*batch 2 2"]) -> tuple[Float[Tensor, "*batch 2"], Float[Tensor, "*batch 2"]]:
    """The parts of J that turn and scale (s), and that shear and mirror (d); |J|^2 = (|s|^2 + |d|^2) / 2."""
    a, b, c, d = jacobians[..., 0, 0], jacobians[..., 0, 1], jacobians[..., 1, 0], jacobians[..., 1, 1]
    return torch.stack([a + d, c - b], -1), torch.stack([a - d, c + b], -1)


def _rest_frames(corners: Float[Tensor, "F 3 2"]) -> tuple[Float[Tensor, "F 2 2"], Float[Tensor, "F"]]:
    """Inverse edge matrices and areas; zeros for triangles without area."""
    edges = _edges(corners)
    a, b, c, d = edges[:, 0, 0], edges[:, 0, 1], edges[:, 1, 0], edges[:, 1, 1]
    determinants = a * d - b * c
    extent = (corners.amax((0, 1)) - corners.amin((0, 1))).amax() if len(corners) else corners.new_zeros(())
    is_solid = determinants.abs() > 2.0 * LEAST_AREA_SHARE * extent**2
    adjugates = torch.stack([torch.stack([d, -b], -1), torch.stack([-c, a], -1)], -2)
    safe = torch.where(is_solid, determinants, torch.ones_like(determinants))
    inverses = torch.where(is_solid[:, None, None], adjugates / safe[:, None, None], 0.0)
    return inverses, torch.where(is_solid, 0.5 * determinants.abs(), 0.0)


def _directed_edges(
    rest: Float[Tensor, "V 2"], triangles: Int[Tensor, "F 3"]
) -> tuple[Int[Tensor, "E"], Int[Tensor, "E"], Float[Tensor, "E"]]:
    """Each edge in both directions, with half the sum of the cotangents across it, at least 0."""
    _, areas = _rest_frames(rest[triangles])
    across = rest[triangles]
    one, two = across.roll(-1, 1) - across, across.roll(-2, 1) - across
    safe = torch.where(areas > 0, areas, torch.ones_like(areas))[:, None]
    halves = torch.where(areas[:, None] > 0, (one * two).sum(-1) / (4.0 * safe), 0.0)
    ends = torch.stack([triangles.roll(-1, 1), triangles.roll(-2, 1)], -1).reshape(-1, 2).sort(-1).values
    pairs, which = torch.unique(ends, dim=0, return_inverse=True)
    weights = halves.new_zeros(len(pairs)).index_add(0, which, halves.reshape(-1)).clamp_min(0.0)
    return torch.cat([pairs[:, 0], pairs[:, 1]]), torch.cat([pairs[:, 1], pairs[:, 0]]), torch.cat([weights, weights])
