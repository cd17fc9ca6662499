"""Lower the handles' energy over the vertices themselves.

``pull_vertices`` is the baseline that Neural Puppet compares with: the same energy, no network, here by Newton's method
until nothing moves. L_deform alone leaves open where the puppet as a whole is and how its limbs are turned, so that a
single handle could be met by moving everything; ``hold`` (per unit of area) makes the answer the one nearest to the
start. ``settle`` moves a pose that nearly meets its handles until it meets them exactly: handles and hinges are linear
constraints, the bend is the least.
"""

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

from wildpuppet.fit.handles import DeformEnergy

HOLD = 3.0
"""Pull of each vertex towards its start. Higher: the neighbourhood of a handle moves; lower: all of the puppet."""
SETTLE_HOLD = 100.0
"""The same for the last pixel: local."""
MOST_STEPS = 100
SMALL = 1e-8
"""Share of the energy under which a step counts as none."""
TIE = 1e-10
"""Lets constraints that say the same thing twice agree on the mean."""
MOST_DAMPING = 1e8


def pull_vertices(
    energy: DeformEnergy, start: Float[np.ndarray, "V 2"], hold: float = HOLD, most_steps: int = MOST_STEPS
) -> Float[np.ndarray, "V 2"]:
    """Lower the energy over the vertices (pixels), from ``start``, to its minimum."""
    first = start.reshape(-1).astype(np.float64) * energy.unit
    x, held = first, hold * energy.mass

    def total(at: Float[np.ndarray, "X"]) -> float:
        return energy.value(at) + float(held @ (at - first) ** 2)

    value, damping = total(x), 1e-6
    for _ in range(most_steps):
        slope = 0.5 * energy.gradient(x) + held * (x - first)
        curvature = _curvature(energy, x) + sparse.diags_array(held)
        while True:
            step = splu(sparse.csc_array(curvature + damping * sparse.eye_array(len(x)))).solve(-slope)
            found = total(x + step)
            if found <= value or damping > MOST_DAMPING:
                break
            damping = 10.0 * max(damping, 1e-9)
        if found > value:
            break
        is_done = value - found <= SMALL * max(value, np.finfo(float).tiny)
        x, value, damping = x + step, found, 0.2 * damping
        if is_done:
            break
    return np.asarray((x / energy.unit).reshape(-1, 2))


def settle(
    energy: DeformEnergy, near: Float[np.ndarray, "V 2"], hold: float = SETTLE_HOLD, steps: int = 3
) -> Float[np.ndarray, "V 2"]:
    """Bend a pose (pixels) as little as can be so that every handle stands at its target; hinges' gaps stay.

    ``energy`` is prepared with ``near`` for its rest shape. Targets that contradict each other are met on average.
    """
    first = near.reshape(-1).astype(np.float64) * energy.unit
    held = hold * energy.mass
    fixed = sparse.csr_array(sparse.vstack([energy.user, energy.joints]))
    wanted = np.concatenate([energy.targets, energy.joints @ first])
    ties = -TIE * sparse.eye_array(len(wanted))
    x = first
    for _ in range(steps):
        rows, stretched = energy.rows(x), energy.tension(x)
        bent = rows.jacobian[energy.user.shape[0] + energy.joints.shape[0] :]
        slope = bent.T @ rows.residual[len(wanted) :] + held * (x - first)
        curvature = bent.T @ bent + stretched.T @ stretched + sparse.diags_array(held)
        system = sparse.csc_array(sparse.block_array([[curvature, fixed.T], [fixed, ties]]))
        answer = splu(system).solve(np.concatenate([-slope, wanted - fixed @ x]))
        x = x + answer[: len(x)]
    return np.asarray((x / energy.unit).reshape(-1, 2))


def _curvature(energy: DeformEnergy, x: Float[np.ndarray, "X"]) -> sparse.csr_array:
    rows, stretched = energy.rows(x).jacobian, energy.tension(x)
    return sparse.csr_array(rows.T @ rows + stretched.T @ stretched)
