"""Lower the handles' energy over the codes of a decoder: the puppet stays among poses that it was seen in.

Two ways. ``plain_steps`` is the paper's: z <- z - 3e-4 dL_deform/dz, 2 to 5 times. ``pull_codes`` is Gauss-Newton with
Levenberg's damping over z = centre + y directions,

    L_deform(decode(z)) + spread^2 |y|^2,

where centre and directions come from poses that are known (``motion/drag.py``), so that a step of length 1 along a
direction is as usual as the poses are. The Jacobian of the decoder is taken forwards along the few directions (as many
rows of one batch), never for all of z.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.fit.handles import DeformEnergy

PAPER_STEP = 3e-4
PAPER_STEPS = 5
MOST_STEPS = 12
SMALL = 1e-3
"""Share of the energy under which a step is the last."""
MOST_DAMPING = 1e6


@runtime_checkable
class Decoder(Protocol):
    """Anything that takes codes to vertices: the deformation network, or a space made of known poses."""

    def decode_tensor(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes (float64), pixels; differentiable, also forwards."""


@dataclass(frozen=True, eq=False)
class Subspace:
    """Where the answer is looked for: codes ``centre + y @ directions``, y of about unit length.

    ``spread`` is how exactly handles are to be met beside a y of length 1, in units of [-1, 1]: lower follows the
    handles farther from known poses.
    """

    centre: Float[np.ndarray, "Z"]
    directions: Float[np.ndarray, "K Z"]
    spread: float


def decode(decoder: Decoder, code: Float[np.ndarray, "Z"]) -> Float[np.ndarray, "V 2"]:
    """Find one code's vertices."""
    with torch.no_grad():
        vertices = decoder.decode_tensor(torch.from_numpy(np.array(code, np.float64))[None])[0]
    return np.asarray(vertices.numpy(), np.float64)


def decode_with_jacobian(
    decoder: Decoder, code: Float[np.ndarray, "Z"], directions: Float[np.ndarray, "K Z"]
) -> tuple[Float[np.ndarray, "V 2"], Float[np.ndarray, "V 2 K"]]:
    """Find one code's vertices and their derivative along directions."""
    at, along = (torch.from_numpy(np.array(array, np.float64)) for array in (code, directions))

    def one(values: Float[Tensor, "Z"]) -> Float[Tensor, "V 2"]:
        return decoder.decode_tensor(values[None])[0]

    def derivative(direction: Float[Tensor, "Z"]) -> Tensor:
        moved: Tensor = torch.func.jvp(one, (at,), (direction,))[1]
        return moved

    moved = torch.func.vmap(derivative, out_dims=-1)(along)
    return decode(decoder, code), moved.detach().numpy().astype(np.float64)


def plain_steps(
    energy: DeformEnergy,
    decoder: Decoder,
    code: Float[np.ndarray, "Z"],
    steps: int = PAPER_STEPS,
    rate: float = PAPER_STEP,
) -> Float[np.ndarray, "Z"]:
    """Take the paper's steps from a code; give the last."""
    found = np.array(code, np.float64)
    for _ in range(steps):
        leaf = torch.from_numpy(found.copy()).requires_grad_()
        vertices = decoder.decode_tensor(leaf[None])[0]
        slope = energy.gradient(vertices.detach().numpy().astype(np.float64).reshape(-1) * energy.unit)
        above = torch.from_numpy(slope.reshape(-1, 2) * energy.unit).to(vertices)
        (downhill,) = torch.autograd.grad(vertices, leaf, above)
        found = found - rate * downhill.numpy().astype(np.float64)
    return found


def pull_codes(
    energy: DeformEnergy, decoder: Decoder, space: Subspace, most_steps: int = MOST_STEPS
) -> Float[np.ndarray, "Z"]:
    """Lower L_deform and the distance from known poses; give the code."""
    y, prior = np.zeros(len(space.directions)), space.spread**2

    def code_of(at: Float[np.ndarray, "K"]) -> Float[np.ndarray, "Z"]:
        return np.asarray(space.centre + at @ space.directions)

    def total(at: Float[np.ndarray, "K"]) -> float:
        return energy.value(decode(decoder, code_of(at)).reshape(-1) * energy.unit) + prior * float(at @ at)

    value, damping = total(y), 1e-4
    for _ in range(most_steps if len(y) else 0):
        normal, slope = _normal(energy, decoder, code_of(y), space.directions)
        normal, slope = normal + prior * np.eye(len(y)), slope + prior * y
        while True:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -slope)
            found = total(y + step)
            if found <= value or damping > MOST_DAMPING:
                break
            damping *= 10.0
        if found > value:
            break
        is_done = value - found <= SMALL * value
        y, value, damping = y + step, found, 0.1 * damping
        if is_done:
            break
    return code_of(y)


def _normal(
    energy: DeformEnergy, decoder: Decoder, code: Float[np.ndarray, "Z"], directions: Float[np.ndarray, "K Z"]
) -> tuple[Float[np.ndarray, "K K"], Float[np.ndarray, "K"]]:
    """Half the Gauss-Newton curvature and half the slope of L_deform along the directions."""
    vertices, moved = decode_with_jacobian(decoder, code, directions)
    rows = energy.rows(vertices.reshape(-1) * energy.unit)
    reduced = rows.jacobian @ (moved.reshape(-1, len(directions)) * energy.unit)
    return reduced.T @ reduced, reduced.T @ rows.residual
