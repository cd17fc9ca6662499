"""Parts that bend: an arm or a tail drawn as one piece moves as two rigid ones with a bend between them.

Cartoon limbs are often one drawing each, knees and elbows included. A rigid template of a bent leg fits nowhere, so a
slender part is cut across the middle of its length. The two pieces overlap in a disc about the bend, and the part's
mesh goes over smoothly from one to the other (linear blend skinning).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.puppet.atlas import layer_picture
from wildpuppet.puppet.colour import lab
from wildpuppet.types import Puppet

LEAST_LENGTH, LEAST_WIDTH = 0.3, 0.04
"""Sizes of a part that bends, as shares of the puppet's larger side: a stick has nothing to tell its halves by."""
TWIN = 0.75
"""Share of what a part must be to bend that is enough for one that looks like a part that does, and has its size."""
ALIKE = 15.0
"""Largest distance in Lab between the mean colours of parts that look alike."""


@dataclass(frozen=True, eq=False)
class Extent:
    """How a part lies: the middle of its length, a unit vector along it, its sizes (pixels) and its colour (Lab)."""

    middle: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    length: float
    width: float
    width_in_middle: float
    colour: Float[np.ndarray, "3"]


def with_bends(puppet: Puppet, slender: float) -> Puppet:
    """Let parts bend that are ``slender`` times as long as wide, or more; 0: none.

    Of two parts that look alike both bend or neither.
    """
    if not slender:
        return puppet
    side = float(np.ptp(puppet.vertices, axis=0).max())
    extents = [extent_of(puppet, layer) for layer in range(puppet.num_layers)]
    share = np.array([
        min(one.length / one.width / slender, one.length / (LEAST_LENGTH * side), one.width / (LEAST_WIDTH * side))
        for one in extents
    ])  # fmt: skip
    sure = np.flatnonzero(share >= 1).tolist()
    chosen = [
        layer
        for layer in np.flatnonzero(share >= TWIN).tolist()
        if layer in sure or any(_alike(extents[layer], extents[other]) for other in sure)
    ]
    return replace(
        puppet,
        bend_layers=np.array(chosen, np.int64),
        bend_points=np.array([extents[layer].middle for layer in chosen]).reshape(-1, 2),
        bend_axes=np.array([extents[k].along * extents[k].width_in_middle / 2 for k in chosen]).reshape(-1, 2),
    )


def _alike(a: Extent, b: Extent) -> bool:
    same_size = all(TWIN < mine / other < 1 / TWIN for mine, other in ((a.length, b.length), (a.width, b.width)))
    return same_size and float(np.linalg.norm(a.colour - b.colour)) < ALIKE


def extent_of(puppet: Puppet, layer: int) -> Extent:
    """Measure a part's drawn pixels along their principal axis."""
    patch, corner = layer_picture(puppet, layer)
    rows, columns = np.nonzero(patch[..., 3] >= min(128, int(patch[..., 3].max())))
    points = np.stack([columns, rows], -1) + 0.5 + corner
    centre = points.mean(0)
    _, axes = np.linalg.eigh((points - centre).T @ (points - centre))
    across, along = (points - centre) @ axes.T[0], (points - centre) @ axes.T[1]
    start, end = np.percentile(along, (1, 99))
    length = max(float(end - start), 1.0)
    near = across[np.abs(along - (start + end) / 2) < max(1.5, 0.05 * length)]
    near = near if len(near) else np.zeros(1)
    return Extent(
        centre + axes.T[1] * (start + end) / 2 + axes.T[0] * near.mean(),
        axes.T[1],
        length,
        max(len(points) / length, 1.0),
        max(float(np.ptp(near)), 1.0),
        lab((patch[rows, columns, :3] / 255).astype(np.float32)[None])[0].mean(0),
    )


def skin(puppet: Puppet) -> tuple[Int[np.ndarray, "V 2"], Float[np.ndarray, "V"]]:
    """Give the pieces that move each vertex, and the second one's share of its movement."""
    layer_of_piece = puppet.layer_of_piece
    pieces = np.stack([np.searchsorted(layer_of_piece, puppet.layer_of_vertex, side) for side in ("left", "right")], -1)
    pieces[:, 1] -= 1
    share = np.zeros(len(puppet.vertices))
    for layer, point, axis in zip(puppet.bend_layers, puppet.bend_points, puppet.bend_axes, strict=True):
        mine = puppet.layer_of_vertex == layer
        x = (0.5 + reach_along(puppet.vertices[mine], point, axis) / 2).clip(0, 1)
        share[mine] = x * x * (3 - 2 * x)
    return pieces, share


def reach_along(
    points: Float[np.ndarray, "*batch 2"], point: Float[np.ndarray, "2"], axis: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "*batch"]:
    """Say how far points lie beyond a bend, in its half widths."""
    return np.asarray((points - point) @ axis / (axis @ axis))


def is_of_half(
    points: Float[np.ndarray, "*batch 2"], point: Float[np.ndarray, "2"], axis: Float[np.ndarray, "2"], side: int
) -> Bool[np.ndarray, "*batch"]:
    """Say whether points of a part that bends are drawn on the piece of a side (-1, 1), the shared disc included."""
    radius = float(np.linalg.norm(axis)) + 1
    beyond = side * reach_along(points, point, axis) >= 0
    return np.asarray(beyond | (((points - point) ** 2).sum(-1) <= radius**2))
