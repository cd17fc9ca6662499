"""The code whose vertices come nearest to given ones: what a fit is in the terms of a network without an inverse."""

import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.deform.network import Network

STEPS = 8
DAMPING = 1.0e-3
"""Levenberg's term, as a share of the mean of the normal matrix's diagonal."""


def nearest_code(
    network: Network, vertices: Float[Tensor, "V 2"], trust: Float[Tensor, "V"], start: Float[Tensor, "Z"]
) -> Float[Tensor, "Z"]:
    """Lower the weighted squared distance by damped Gauss-Newton; never ends above where it starts."""

    def residual(code: Float[Tensor, "Z"]) -> Float[Tensor, "n"]:
        return ((network.decode(code[None])[0] - vertices) * trust.sqrt()[:, None]).reshape(-1)

    code, left, damping = start, residual(start), DAMPING
    for _ in range(STEPS):
        jacobian = torch.func.jacrev(residual)(code)
        normal = jacobian.T @ jacobian
        damped = normal + damping * normal.diagonal().mean().clamp_min(1e-12) * torch.eye(len(code))
        moved = code - torch.linalg.solve(damped, jacobian.T @ left)
        found = residual(moved)
        if found.square().sum() < left.square().sum():
            code, left, damping = moved, found, 0.3 * damping
        else:
            damping = 10.0 * damping
    return code.detach()
