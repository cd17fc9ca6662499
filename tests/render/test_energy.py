"""The fused energy against torch autograd on the reference renderer."""

import numpy as np
import pytest
import torch

from tests.render.scenes import grid_puppet
from wildpuppet.render.energy import pixel_energy
from wildpuppet.render.render import render

REFUSED = (ValueError, TypeError)
"""TypeError where annotations are executed."""
SHARE = 2e-3
"""The fused path works in float32 and stops behind 1023/1024 of coverage."""


@pytest.mark.parametrize("epsilon", [0.0, 0.05])
def test_energy_and_gradient_match_autograd(epsilon: float) -> None:
    vertices, mesh, texture, order = grid_puppet(5, 3, 48, seed=11)
    rng = np.random.default_rng(0)
    target = rng.random((3, 40, 48, 3), np.float32)
    covered, uncovered = rng.random((2, 3, 40, 48), np.float32)
    energy, gradient = pixel_energy(vertices.numpy(), mesh, texture, order.numpy(), target, covered, uncovered, epsilon)
    moving = vertices.double().requires_grad_()
    rgba = render(moving, mesh, texture, order, (48, 40), backend="reference").rgba
    alpha, weight = rgba[..., 3], torch.from_numpy(covered)
    square = (alpha[..., None] * torch.from_numpy(target) - rgba[..., :3]).square().sum(-1)
    data = (square + epsilon**2).sqrt() - epsilon if epsilon else square
    expected = (weight * data + (1 - alpha) * torch.from_numpy(uncovered)).sum((1, 2))
    (slope,) = torch.autograd.grad(expected.sum(), moving)
    np.testing.assert_allclose(energy, expected.detach().numpy(), rtol=1e-4)
    assert np.linalg.norm(gradient - slope.numpy()) < SHARE * float(slope.norm())


def test_sizes_that_disagree_are_refused_and_read_only_arrays_are_not() -> None:
    vertices, mesh, texture, order = grid_puppet(2, 2, 16, seed=1)
    target, weight = np.zeros((2, 16, 16, 3)), np.ones((2, 16, 16))
    weight.flags.writeable = False
    energy, _ = pixel_energy(vertices.numpy(), mesh, texture, order.numpy(), target, weight, weight, 0.1)
    assert energy.shape == (2,)
    with pytest.raises(REFUSED):
        pixel_energy(vertices.numpy(), mesh, texture, order.numpy(), target, weight[:, :8], weight, 0.1)
    with pytest.raises(REFUSED):
        pixel_energy(vertices.numpy(), mesh, texture, order.numpy(), target[:1], weight[:1], weight[:1], 0.1)
