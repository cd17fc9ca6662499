"""Where the puppet stands before any search: its rest box matched to the character's box."""

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.errors import PuppetError
from wildpuppet.geometry import affine
from wildpuppet.puppet.atlas import layer_picture
from wildpuppet.puppet.bends import skin
from wildpuppet.types import Crops, Puppet

SAME_BOX = 0.6
"""Overlap (intersection over union) of box and rest box from which a puppet drawn on this very video stays in place."""


def rest_box(puppet: Puppet) -> Float[np.ndarray, "4"]:
    """Box (x, y, w, h) of the drawn (opaque) area at rest, canvas pixels."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for layer in range(puppet.num_layers):
        picture, corner = layer_picture(puppet, layer)
        rows, columns = np.nonzero(picture[..., 3] > 127)
        if len(rows):
            low = np.minimum(low, corner + np.array([columns.min(), rows.min()]))
            high = np.maximum(high, corner + np.array([columns.max(), rows.max()]) + 1)
    if not np.isfinite(low).all():
        raise PuppetError("the puppet's parts are fully transparent; expected drawings with opaque pixels")
    return np.concatenate([low, high - low])


def place(puppet: Puppet, crops: Crops) -> Float[np.ndarray, "2 3"]:
    """Map canvas to the reference crop (or to every crop of unordered drawings, which share one canvas).

    A puppet drawn on this very picture (same canvas, boxes that agree) stays where it was drawn; any other is scaled
    and moved so that its rest box has the area and the centre of the character's box.
    """
    index = crops.reference or 0
    if is_drawn_here(puppet, crops):
        return affine.invert(crops.video_from_crop[index])
    box, target = rest_box(puppet), np.asarray(crops.box_crop[index], np.float64)
    scale = float(np.sqrt(target[2] * target[3] / (box[2] * box[3])))
    shift = target[:2] + target[2:] / 2 - scale * (box[:2] + box[2:] / 2)
    return affine.scale_and_shift(scale, (float(shift[0]), float(shift[1])))


def is_drawn_here(puppet: Puppet, crops: Crops) -> bool:
    """Say whether the puppet was drawn on the reference picture itself: same canvas, boxes that agree."""
    index = crops.reference or 0
    box = rest_box(puppet)
    corners = affine.apply(affine.invert(crops.video_from_crop[index]), np.stack([box[:2], box[:2] + box[2:]]))
    placed = np.concatenate([corners[0], corners[1] - corners[0]])
    return not crops.ordered or _overlap(placed, np.asarray(crops.box_crop[index], np.float64)) > SAME_BOX


def between(crops: Crops, source: int, target: int) -> Float[np.ndarray, "2 3"]:
    """Map the crop ``source`` to the crop ``target``, what they show standing still in the video."""
    return affine.compose(affine.invert(crops.video_from_crop[target]), crops.video_from_crop[source])


def size_of(crop_from_canvas: Float[np.ndarray, "2 3"]) -> float:
    """Give a similarity's scale: crop pixels per canvas pixel."""
    return float(np.sqrt(abs(np.linalg.det(crop_from_canvas[:, :2]))))


def pose_vertices(
    puppet: Puppet, crop_from_canvas: Float[np.ndarray, "*batch P 2 3"]
) -> Float[np.ndarray, "*batch V 2"]:
    """Move every layer's rest vertices by the maps of its pieces, or by its own where there is one per layer."""
    if crop_from_canvas.shape[-3] == puppet.num_layers:
        return _moved(puppet, crop_from_canvas, puppet.layer_of_vertex)
    pieces, share = skin(puppet)
    first, second = (_moved(puppet, crop_from_canvas, pieces[:, side]) for side in (0, 1))
    return np.asarray(first + share[:, None] * (second - first))


def _moved(
    puppet: Puppet, crop_from_canvas: Float[np.ndarray, "*batch P 2 3"], piece: Int[np.ndarray, "V"]
) -> Float[np.ndarray, "*batch V 2"]:
    maps = crop_from_canvas[..., piece, :, :]
    return np.asarray((maps[..., :2] @ puppet.vertices[:, :, None])[..., 0] + maps[..., 2])


def _overlap(a: Float[np.ndarray, "4"], b: Float[np.ndarray, "4"]) -> float:
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[:2] + a[2:], b[:2] + b[2:])
    shared = float(np.prod(np.clip(high - low, 0, None)))
    return shared / max(float(a[2] * a[3] + b[2] * b[3]) - shared, 1e-9)
