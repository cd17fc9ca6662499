"""Parts as similarities of their rest shapes: read off posed vertices, or set through given points."""

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.geometry import affine
from wildpuppet.types import Puppet


def similarities(puppet: Puppet, vertices: Float[np.ndarray, "*batch V 2"]) -> Float[np.ndarray, "*batch L 2 3"]:
    """Fit each layer's vertices by a similarity of its rest vertices, in the least-squares sense."""
    maps = []
    for layer in range(puppet.num_layers):
        mine = puppet.layer_of_vertex == layer
        rest, posed = puppet.vertices[mine].astype(np.float64), vertices[..., mine, :].astype(np.float64)
        middle, centre = rest.mean(0), posed.mean(-2)
        cos, sin = _turn(rest - middle, posed - centre[..., None, :])
        linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        linear /= max(float(((rest - middle) ** 2).sum()), 1e-9)
        maps.append(np.concatenate([linear, (centre - linear @ middle)[..., None]], -1))
    return np.stack(maps, -3)


def placed(
    crop_from_canvas: Float[np.ndarray, "L 2 3"],
    layers: Int[np.ndarray, " n"],
    points_canvas: Float[np.ndarray, "n 2"],
    points_crop: Float[np.ndarray, "n 2"],
) -> Float[np.ndarray, "L 2 3"]:
    """Set each part that has points through them by least squares, its size kept; the others stay.

    One point shifts its part, two or more turn it too.
    """
    maps = crop_from_canvas.astype(np.float64)
    for layer in np.unique(layers):
        rest, given = points_canvas[layers == layer], points_crop[layers == layer]
        middle, centre = rest.mean(0), given.mean(0)
        now = affine.apply(maps[layer], rest)
        cos, sin = _turn(now - now.mean(0), given - centre)
        length = float(np.hypot(cos, sin))
        if length > 1e-9:
            turn = np.array([[cos, -sin], [sin, cos]]) / length
            maps[layer, :, :2] = turn @ maps[layer, :, :2]
        maps[layer, :, 2] = centre - maps[layer, :, :2] @ middle
    return maps


def _turn(
    before: Float[np.ndarray, "*#batch n 2"], after: Float[np.ndarray, "*batch n 2"]
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Cosine and sine, not normalised, of the turn that lays centred points on others."""
    cos = (before * after).sum((-1, -2))
    sin = (before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]).sum(-1)
    return np.asarray(cos), np.asarray(sin)
