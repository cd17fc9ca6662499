"""Table 2: how well points are carried between any two of the drawings kept for testing.

For every ordered pair (a, b) of them the true points of a are carried to b. A point counts where it is visible in
both, and is right at alpha when it lands within alpha * L of its true place; L is the larger side of the drawing.
All pairs of a character count together, each point as much as any other.
"""

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.correspond.locate import locate
from wildpuppet.correspond.pck import Truth
from wildpuppet.geometry.affine import apply
from wildpuppet.types import Crops, Fit, Puppet

ALPHAS = (0.1, 0.05, 0.025)


def carried_by_puppet(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    frames: Int[np.ndarray, "A"],
    points: Float[np.ndarray, "A N 2"],
    layers: Int[np.ndarray, "N"] | None = None,
) -> Float[np.ndarray, "A A N 2"]:
    """Carry every drawing's points to every drawing through the puppet.

    ``frames`` index the fit. ``layers`` name the part of each point, -1 where it is not known; without it a point lies
    on the frontmost part under it, else on the nearest. Points that are not finite stay so.
    """
    vertices = apply(crops.video_from_crop[frames], fit.vertices_crop[frames].astype(np.float64))
    names = None if layers is None else [None if layer < 0 else puppet.names[layer] for layer in layers.tolist()]
    carried = []
    for index, start in enumerate(points.astype(np.float64)):
        anchors = locate(puppet, vertices[index], fit.order[frames[index]], start, names)
        moved = anchors.mix(vertices)
        moved[index] = start
        carried.append(moved)
    return np.stack(carried)


def copied(points: Float[np.ndarray, "A N 2"]) -> Float[np.ndarray, "A A N 2"]:
    """Leave every drawing's points where they are."""
    return np.repeat(points[:, None].astype(np.float64), len(points), 1)


def score_pairs(
    truth: Truth, frames: Int[np.ndarray, "A"], carried: Float[np.ndarray, "A A N 2"]
) -> tuple[dict[float, float], int]:
    """Give the percentage of right points by alpha, and how many points were counted; NaN where there are none.

    ``carried[a, b, n]`` is point n of drawing ``frames[a]`` in drawing ``frames[b]``; one that is not finite is wrong.
    """
    points, visible = truth.points[frames], truth.visible[frames]
    if carried.shape != (len(frames), *points.shape):
        raise ValueError(f"expected carried points of shape {(len(frames), *points.shape)}, found {carried.shape}")
    counted = visible[:, None] & visible[None] & ~np.eye(len(frames), dtype=bool)[..., None]
    error = np.linalg.norm(carried - points[None].astype(np.float64), axis=-1)
    share = np.where(np.isfinite(error), error, np.inf) / truth.length[frames][None, :, None]
    number = int(counted.sum())
    if number == 0:
        return dict.fromkeys(ALPHAS, float("nan")), 0
    return {alpha: 100.0 * float((share[counted] < alpha).mean()) for alpha in ALPHAS}, number
