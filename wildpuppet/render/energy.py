"""The data term of a fit in one call: render, compare with a picture and go back to the vertices, without torch."""

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int

from wildpuppet.render.cpu import kernel_arguments, scene_of
from wildpuppet.render.energy_kernel import energy_frames
from wildpuppet.render.mesh import Mesh
from wildpuppet.render.render import check_scene
from wildpuppet.render.texture import Texture
from wildpuppet.render.threads import run_shares, shares


def pixel_energy(
    vertices: Float[np.ndarray, "B V 2"],
    mesh: Mesh,
    texture: Texture,
    order: Int[np.ndarray, "B L"],
    target: Float[np.ndarray, "B H W 3"],
    covered_weight: Float[np.ndarray, "B H W"],
    uncovered_cost: Float[np.ndarray, "B H W"],
    epsilon: float,
) -> tuple[Float64[np.ndarray, "B"], Float32[np.ndarray, "B V 2"]]:
    """Compute E = sum over pixels of covered_weight rho(|A I - R|) + (1 - A) uncovered_cost, and dE/d vertices.

    R and A are the rendering's premultiplied colour (0..1) and alpha at the target's size, I the target (0..1).
    rho(d) = sqrt(d^2 + epsilon^2) - epsilon, or d^2 where ``epsilon`` is 0: higher is smoother near 0, lower closer
    to the plain distance, which outliers cannot pull. Runs on the CPU in float32; arrays that are float32, contiguous
    and writable are not copied. Raises ValueError as ``render`` does, and for images whose sizes disagree.
    """
    batch, height, width = target.shape[:3]
    positions, orders = torch.from_numpy(_plain(vertices)), torch.from_numpy(np.array(order, np.int64))
    check_scene(positions, mesh, texture, orders, (width, height), None)
    expected = (batch, height, width)
    if not len(vertices) == batch or not covered_weight.shape == uncovered_cost.shape == expected:
        raise ValueError(f"targets are {expected}: weights and vertices must have the same frames and size")
    scene = scene_of(mesh, texture.uv.to(positions), orders, (width, height))
    arguments = kernel_arguments(positions, texture.rgba.to(positions), torch.ones(orders.shape), scene)
    num_pixels = height * width
    target = _plain(target).reshape(batch, num_pixels * 3)
    covered_weight, uncovered_cost = (
        _plain(image).reshape(batch, num_pixels) for image in (covered_weight, uncovered_cost)
    )
    energy, gradient = np.zeros(batch), np.zeros(positions.shape, np.float32)
    run_shares(
        lambda _, first, end: energy_frames(
            first, end, *arguments, target, covered_weight, uncovered_cost, np.float32(epsilon), energy, gradient
        ),
        shares(batch),
    )
    return energy, gradient


def _plain(array: Float[np.ndarray, "*_"]) -> Float32[np.ndarray, "*_"]:
    """Return the array as the kernels are compiled for it: float32, contiguous, writable."""
    plain: Float32[np.ndarray, "*_"] = np.require(array, np.float32, ("C", "W"))
    return plain
