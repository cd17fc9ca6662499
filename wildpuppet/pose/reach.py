"""Parts put where given points say, their chains following: inverse kinematics by least squares.

Every part keeps its size and is turned and shifted from where it stands. Points weigh most, then hinges, then staying
where it was, large parts more than small ones; so a hand that is given pulls its arm along rather than the body.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares

from wildpuppet.geometry import affine
from wildpuppet.pose.tree import part_areas
from wildpuppet.types import Puppet

# Weights of residuals, each a share of the character's size.
POINT, HINGE, STAY = 100.0, 10.0, 0.5
MOST_ROUNDS = 40


def reach(
    puppet: Puppet,
    crop_from_canvas: Float[np.ndarray, "L 2 3"],
    layers: Int[np.ndarray, " n"],
    points_canvas: Float[np.ndarray, "n 2"],
    points_crop: Float[np.ndarray, "n 2"],
) -> Float[np.ndarray, "L 2 3"]:
    """Move a pose's parts so that ``points_canvas`` of ``layers`` come to ``points_crop``, as nearly as parts can."""
    maps = crop_from_canvas.astype(np.float64)
    centres = np.stack([puppet.vertices[puppet.layer_of_vertex == layer].mean(0) for layer in range(len(maps))])
    pivots = affine.apply(maps, centres[:, None])[:, 0]
    hinges = (puppet.vertices[puppet.joint_vertices] * puppet.joint_weights[..., None]).sum(-2).astype(np.float64)
    size = max(float(np.ptp(pivots, axis=0).max()), 1.0)
    areas = part_areas(puppet)
    radii = np.sqrt(areas * np.abs(np.linalg.det(maps[:, :, :2])) / np.pi) / size
    stay = STAY * (areas / areas.mean())[:, None] * np.stack([radii, np.ones(len(maps)), np.ones(len(maps))], 1)

    def posed(moves: Float[np.ndarray, " M"]) -> Float[np.ndarray, "L 2 3"]:
        table = moves.reshape(-1, 3)
        turns = affine.similarity(np.ones(len(maps)), table[:, 0], np.zeros((len(maps), 2)))
        turns[:, :, 2] = pivots + size * table[:, 1:] - affine.apply(turns, pivots[:, None])[:, 0]
        return affine.compose(turns, maps)

    def residuals(moves: Float[np.ndarray, " M"]) -> Float[np.ndarray, " R"]:
        now, table = posed(moves), moves.reshape(-1, 3)
        off = affine.apply(now[layers], points_canvas[:, None])[:, 0] - points_crop
        sides = affine.apply(now[puppet.joint_layers], hinges[:, :, None])[:, :, 0]
        gaps = (sides[:, 0] - sides[:, 1]) / size
        return np.concatenate([POINT / size * off.ravel(), HINGE * gaps.ravel(), (stay * table).ravel()])

    found = least_squares(residuals, np.zeros(3 * len(maps)), method="trf", max_nfev=MOST_ROUNDS)
    return posed(found.x)


def similarities(puppet: Puppet, vertices: Float[np.ndarray, "*batch V 2"]) -> Float[np.ndarray, "*batch L 2 3"]:
    """Fit each layer's vertices by a similarity of its rest vertices, in the least-squares sense."""
    maps = []
    for layer in range(puppet.num_layers):
        mine = puppet.layer_of_vertex == layer
        rest, posed = puppet.vertices[mine].astype(np.float64), vertices[..., mine, :].astype(np.float64)
        middle, centre = rest.mean(0), posed.mean(-2)
        arm, moved = rest - middle, posed - centre[..., None, :]
        squares = max(float((arm**2).sum()), 1e-9)
        cos = (moved * arm).sum((-1, -2)) / squares
        sin = (moved[..., 1] * arm[:, 0] - moved[..., 0] * arm[:, 1]).sum(-1) / squares
        linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        maps.append(np.concatenate([linear, (centre - linear @ middle)[..., None]], -1))
    return np.stack(maps, -3)
