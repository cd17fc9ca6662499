"""What a pose pays for opening its hinges and for turning parts against each other, off the grid.

The same costs as in ``dynamic``: Huber's function of the gap along each axis, and of the turn.
"""

import numpy as np
from jaxtyping import Float

from wildpuppet.geometry import affine
from wildpuppet.pose.tree import Tree
from wildpuppet.settings import SearchSettings


def spring_costs(
    crop_from_canvas: Float[np.ndarray, "N L 2 3"], tree: Tree, size: float, settings: SearchSettings
) -> Float[np.ndarray, "N"]:
    """Sum over the tree's edges; ``size`` is the character's, in the pixels of the maps."""
    total = np.zeros(len(crop_from_canvas))
    for edge in tree.edges:
        parent, child = crop_from_canvas[:, edge.parent], crop_from_canvas[:, edge.child]
        at = np.broadcast_to(np.asarray(edge.at), (len(total), 1, 2))
        gap = np.abs(affine.apply(parent, at) - affine.apply(child, at))[:, 0]
        slack = settings.hinge_slack * size * (1 if edge.is_hinge else 2)
        total += (settings.hinge * huber(gap / slack)).sum(-1)
        turn = np.arctan2(child[:, 1, 0], child[:, 0, 0]) - np.arctan2(parent[:, 1, 0], parent[:, 0, 0])
        turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
        total += settings.turn * huber(turn / LINEAR_TURN) * LINEAR_TURN**2
    return total


LINEAR_TURN = 0.5
"""Radians beyond which a turn's cost is linear."""


def huber(ratio: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Square up to 1, linear beyond."""
    return np.where(ratio < 1, ratio**2, 2 * ratio - 1)
