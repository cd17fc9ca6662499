import numpy as np
import pytest
import torch
from scipy.spatial import Delaunay

from wildpuppet.geometry.arap import (
    arap_energy,
    arap_energy_and_gradient,
    arap_rest,
    best_scale,
    best_scale_of,
    cell_energy,
)

torch.set_num_threads(1)


@pytest.fixture
def mesh() -> tuple[torch.Tensor, torch.Tensor]:
    """A jittered hexagonal patch: all angles acute, so that no cotangent is negative."""
    generator = np.random.default_rng(0)
    columns, rows = np.meshgrid(np.arange(5.0), np.arange(6.0))
    grid = np.stack([columns + 0.5 * (rows % 2), rows * np.sqrt(0.75)], -1).reshape(-1, 2)
    points = 10.0 * (grid + generator.uniform(-0.05, 0.05, grid.shape))
    faces = Delaunay(points).simplices
    sides = np.linalg.norm(points[faces] - points[np.roll(faces, 1, 1)], axis=-1)
    return torch.from_numpy(points), torch.from_numpy(faces[sides.max(1) < 13.0].astype(np.int64))


def posed(rest: torch.Tensor, radians: float, scale: float = 1.0, noise: float = 0.0) -> torch.Tensor:
    cos, sin = scale * np.cos(radians), scale * np.sin(radians)
    turned = rest @ torch.tensor([[cos, sin], [-sin, cos]], dtype=rest.dtype) + torch.tensor([3.0, -7.0])
    generator = torch.Generator().manual_seed(1)
    return (turned + noise * torch.randn(rest.shape, generator=generator, dtype=rest.dtype))[None]


@pytest.mark.parametrize("energy", [arap_energy, cell_energy])
def test_moving_and_turning_costs_nothing(energy, mesh):
    rest, triangles = mesh
    assert abs(energy(posed(rest, 2.1), rest, triangles).item()) < 1e-8


@pytest.mark.parametrize("energy", [arap_energy, cell_energy])
def test_scale_is_the_rest_shapes(energy, mesh):
    rest, triangles = mesh
    small = posed(rest, -0.7, scale=0.6)
    assert energy(small, rest, triangles).item() > 100.0
    assert abs(energy(small, rest, triangles, torch.tensor([0.6], dtype=torch.float64)).item()) < 1e-8


def test_stretch_and_growth_have_closed_forms(mesh):
    # the best rotation stays the identity: |J - I|^2 is 0.25 and 2 * 0.25 on the whole area; cells count edges twice
    rest, triangles = mesh
    corners = rest.numpy()[triangles.numpy()]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    total = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum()
    stretched = (rest * torch.tensor([1.5, 1.0], dtype=rest.dtype))[None]
    assert arap_energy(stretched, rest, triangles).item() == pytest.approx(0.25 * total)
    assert arap_energy(1.5 * rest[None], rest, triangles).item() == pytest.approx(0.5 * total)
    assert cell_energy(1.5 * rest[None], rest, triangles).item() == pytest.approx(1.0 * total)


def test_equals_the_cotangent_energy_with_svd_rotations(mesh):
    rest, triangles = mesh
    after = posed(rest, 0.4, noise=3.0)
    expected = 0.0
    for face in triangles.numpy():
        before_corners, after_corners = rest.numpy()[face], after[0].numpy()[face]
        pairs = [(1, 2), (2, 0), (0, 1)]
        edges = np.array([before_corners[i] - before_corners[j] for i, j in pairs])
        moved = np.array([after_corners[i] - after_corners[j] for i, j in pairs])
        cotangents = []
        for across, (i, j) in enumerate(pairs):
            u, v = before_corners[i] - before_corners[across], before_corners[j] - before_corners[across]
            cotangents.append(u @ v / abs(u[0] * v[1] - u[1] * v[0]))
        left, _, right = np.linalg.svd(moved.T @ np.diag(cotangents) @ edges)
        rotation = left @ np.diag([1.0, np.linalg.det(left @ right)]) @ right
        expected += 0.5 * (np.array(cotangents) * ((moved - edges @ rotation.T) ** 2).sum(1)).sum()
    assert arap_energy(after, rest, triangles).item() == pytest.approx(expected)


def test_cells_take_the_best_rotation(mesh):
    rest, triangles = mesh
    after = posed(rest, 0.9, noise=2.0)
    x, y = rest.numpy(), after[0].numpy()
    weights = np.zeros((len(x), len(x)))
    for face in triangles.numpy():
        for a, b, c in (face, np.roll(face, 1), np.roll(face, 2)):
            u, v = x[b] - x[a], x[c] - x[a]
            weights[b, c] += 0.5 * (u @ v) / abs(u[0] * v[1] - u[1] * v[0])
            weights[c, b] = weights[b, c]
    expected = 0.0
    for i in range(len(x)):
        before, moved = x[i] - x, y[i] - y
        left, _, right = np.linalg.svd(moved.T @ np.diag(weights[i]) @ before)
        rotation = left @ np.diag([1.0, np.linalg.det(left @ right)]) @ right
        expected += (weights[i] * ((moved - before @ rotation.T) ** 2).sum(1)).sum()
    assert cell_energy(after, rest, triangles).item() == pytest.approx(expected)


@pytest.mark.parametrize("energy", [arap_energy, cell_energy])
def test_gradient_matches_finite_differences(energy, mesh):
    rest, triangles = mesh
    after = posed(rest, 0.5, noise=2.0).requires_grad_()
    scale = torch.tensor([1.2], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v, s: energy(v, rest, triangles, s), (after, scale))


@pytest.mark.parametrize(("kind", "tolerance"), [(np.float64, 1e-10), (np.float32, 2e-4)])
def test_numba_equals_torch(mesh, kind, tolerance):
    rest, triangles = mesh
    after = torch.cat([posed(rest, 0.5, noise=2.0), posed(rest, 3.0, scale=0.8, noise=4.0)]).requires_grad_()
    scale = torch.tensor([1.0, 0.8], dtype=torch.float64)
    expected = arap_energy(after, rest, triangles, scale)
    expected.sum().backward()
    prepared = arap_rest(rest.numpy().astype(kind), triangles.numpy())
    moved = after.detach().numpy().astype(kind)
    energy, gradient = arap_energy_and_gradient(moved, prepared, scale.numpy().astype(kind))
    np.testing.assert_allclose(energy, expected.detach().numpy(), rtol=tolerance)
    np.testing.assert_allclose(gradient, after.grad.numpy(), rtol=tolerance, atol=tolerance * 100)
    scales = best_scale(after.detach(), rest, triangles)
    np.testing.assert_allclose(best_scale_of(moved, prepared), scales.numpy(), rtol=tolerance)


def test_best_scale_is_the_least_energy(mesh):
    rest, triangles = mesh
    after = posed(rest, 1.0, scale=0.7, noise=0.5)
    scale = best_scale(after, rest, triangles).requires_grad_()
    (slope,) = torch.autograd.grad(arap_energy(after, rest, triangles, scale).sum(), scale)
    assert abs(slope.item()) < 1e-8
    assert scale.item() == pytest.approx(0.7, abs=0.02)


def test_degenerate_triangles_count_for_nothing(mesh):
    rest, triangles = mesh
    slivers = torch.cat([triangles, torch.tensor([[0, 0, 1], [2, 2, 2]])])
    after = posed(rest, 0.5, noise=2.0)
    for energy in (arap_energy, cell_energy):
        assert energy(after, rest, slivers).item() == pytest.approx(energy(after, rest, triangles).item())
    collapsed = torch.zeros(1, len(rest), 2, dtype=rest.dtype, requires_grad=True)
    arap_energy(collapsed, rest, slivers).sum().backward()
    assert torch.isfinite(collapsed.grad).all()
    energy, gradient = arap_energy_and_gradient(np.zeros((1, len(rest), 2)), arap_rest(rest.numpy(), slivers.numpy()))
    assert np.isfinite(energy).all()
    assert np.isfinite(gradient).all()


def test_wrong_number_of_vertices_is_refused(mesh):
    rest, triangles = mesh
    with pytest.raises(ValueError, match="expected 30 vertices, found 4"):
        arap_energy_and_gradient(np.zeros((1, 4, 2)), arap_rest(rest.numpy(), triangles.numpy()))
