"""Compile the kernels ahead of need, so that a progress bar does not stand still at its start."""

import numpy as np
import torch

from wildpuppet.render.energy import pixel_energy
from wildpuppet.render.mesh import Mesh
from wildpuppet.render.render import render
from wildpuppet.render.surface import surface
from wildpuppet.render.texture import Texture


def compile_kernels() -> None:
    """Run every kernel once on one triangle; seconds on a machine's first run, milliseconds later."""
    mesh = Mesh(torch.tensor([[0, 1, 2]]), torch.tensor([0]), 1)
    vertices = torch.tensor([[[1.0, 1.0], [7.0, 1.0], [1.0, 7.0]]], requires_grad=True)
    texture = Texture(torch.ones(8, 8, 4), vertices[0].detach())
    order = torch.tensor([[0]])
    render(vertices, mesh, texture, order, (8, 8), backend="cpu").rgba.sum().backward()  # type: ignore[no-untyped-call]
    image = np.ones((1, 8, 8, 3), np.float32)
    weight = image[..., 0].copy()
    pixel_energy(vertices.detach().numpy(), mesh, texture, order.numpy(), image, weight, weight, 0.1)
    surface(vertices, mesh, texture, order, (8, 8), backend="cpu")
