"""Meshes and textures that the renderer's tests share."""

import numpy as np
import torch
from torch import Tensor

from wildpuppet.render.render import Mesh, Texture


def square() -> tuple[Tensor, Mesh]:
    """Return a 4 x 4 square at (2, 3): four corners, two triangles of opposite orientation, one layer."""
    corners = torch.tensor([[[2.0, 3.0], [6.0, 3.0], [6.0, 7.0], [2.0, 7.0]]])
    return corners, Mesh(torch.tensor([[0, 1, 2], [0, 3, 2]]), torch.tensor([0, 0]), 1)


def flat_texture(vertices: Tensor, rgba: tuple[float, float, float, float]) -> Texture:
    """Return one colour everywhere (premultiplied)."""
    return Texture(torch.tensor(rgba, dtype=torch.float32).expand(8, 8, 4).contiguous(), vertices[0].clone())


def soft_texture(pixels: int, uv: Tensor, generator: torch.Generator) -> Texture:
    """Return smooth random colours under a random matte that fades to 0 at the texture's edge."""
    coarse = torch.rand(1, 4, 6, 6, generator=generator)
    fine = torch.nn.functional.interpolate(coarse, (pixels, pixels), mode="bicubic", align_corners=True)[0].clamp(0, 1)
    ramp = (torch.arange(pixels) - 1.5).clamp(0, 4) / 4 * (pixels - 2.5 - torch.arange(pixels)).clamp(0, 4) / 4
    alpha = ramp[:, None] * ramp[None, :] * (0.5 + 0.5 * fine[3])
    return Texture(torch.cat([fine[:3] * alpha, alpha[None]]).permute(1, 2, 0).contiguous(), uv)


def grid_cells(side: int) -> Tensor:
    """Return the triangles of a grid of ``side`` x ``side`` vertices."""
    corner = (torch.arange(side - 1)[:, None] * side + torch.arange(side - 1)).reshape(-1)
    right, below, across = corner + 1, corner + side, corner + side + 1
    return torch.cat([torch.stack([corner, right, below], 1), torch.stack([across, below, right], 1)])


def grid_puppet(
    num_layers: int, num_frames: int, pixels: int, seed: int, bend: float = 1.0
) -> tuple[Tensor, Mesh, Texture, Tensor]:
    """Return layers of 4 x 4 cells that overlap at random places, bent and turned, each frame with its own order."""
    generator = torch.Generator().manual_seed(seed)
    steps = torch.linspace(0, 1, 5)
    grid = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1).reshape(-1, 2)
    cells = grid_cells(5)
    triangles = (torch.arange(num_layers)[:, None, None] * 25 + cells).reshape(-1, 3)
    mesh = Mesh(triangles, torch.arange(num_layers).repeat_interleave(len(cells)), num_layers)
    texture = soft_texture(24, grid.repeat(num_layers, 1) * 24, generator)
    turn = torch.rand(num_frames, num_layers, 1, generator=generator) * 6.28
    turns = torch.stack([torch.cos(turn), -torch.sin(turn), torch.sin(turn), torch.cos(turn)], -1).reshape(
        num_frames, num_layers, 2, 2
    )
    centres = (0.2 + 0.6 * torch.rand(num_frames, num_layers, 1, 2, generator=generator)) * pixels
    placed = (grid - 0.5) * 0.6 * pixels @ turns + centres
    vertices = placed.reshape(num_frames, -1, 2)
    vertices = vertices + bend * torch.randn(vertices.shape, generator=generator)
    orders = np.random.default_rng(seed).permuted(np.tile(np.arange(num_layers), (num_frames, 1)), axis=1)
    return vertices, mesh, texture, torch.from_numpy(orders)
