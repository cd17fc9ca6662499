"""A background plate: the median of the pictures of one shot, laid over each other by the camera's motion.

Where a picture is covered (the character's box, where it is known) it does not count. The plate says for each pixel how
much its pictures differ and how many there were: few or differing ones mean that the background is not known there.
Computed in tiles, so that memory does not grow with a long pan.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.geometry import affine
from wildpuppet.track.plate_kernel import masked_median

TILE = 192
# A plate is not made larger than this many times its pictures' area; a longer pan is cut off.
LARGEST_AREA = 30.0


@dataclass(frozen=True, eq=False)
class Plate:
    """One shot's background. ``spread`` is the median deviation of the pictures from it, ``count`` their number."""

    plate_from_plane: Float[np.ndarray, "2 3"]
    colour: UInt8[np.ndarray, "h w 3"]
    spread: UInt8[np.ndarray, "h w"]
    count: UInt8[np.ndarray, "h w"]


def median_plate(
    pictures: Sequence[UInt8[np.ndarray, "a b 3"]],
    visible: Sequence[UInt8[np.ndarray, "a b"]],
    plane_from_frame: Float[np.ndarray, "n 2 3"],
) -> Plate:
    """Lay pictures over each other and take the median of what is ``visible`` (255); at most 255 pictures."""
    height, width = pictures[0].shape[:2]
    corners = affine.apply(plane_from_frame, np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]))
    low = np.floor(corners.reshape(-1, 2).min(0))
    size = np.ceil(corners.reshape(-1, 2).max(0) - low).astype(int)
    limit = np.array([width, height]) * LARGEST_AREA / np.maximum(size[::-1] / np.array([height, width]), 1.0)
    size = np.maximum(np.minimum(size, limit.astype(int)), 1)
    plate_from_plane = affine.scale_and_shift(1.0, (-float(low[0]), -float(low[1])))
    colour = np.zeros((size[1], size[0], 3), np.uint8)
    spread, count = np.zeros((size[1], size[0]), np.uint8), np.zeros((size[1], size[0]), np.uint8)
    plate_from_frame = affine.compose(np.broadcast_to(plate_from_plane, plane_from_frame.shape), plane_from_frame)
    for top in range(0, int(size[1]), TILE):
        for left in range(0, int(size[0]), TILE):
            part = slice(top, top + TILE), slice(left, left + TILE)
            shape = colour[part].shape[:2]
            stack, seen = tile_stack(pictures, visible, plate_from_frame, (left, top), (shape[1], shape[0]))
            if len(stack):
                colour[part], spread[part], count[part] = masked_median(stack, seen)
    return Plate(plate_from_plane, colour, spread, count)


def tile_stack(
    pictures: Sequence[UInt8[np.ndarray, "a b 3"]],
    visible: Sequence[UInt8[np.ndarray, "a b"]],
    plate_from_frame: Float[np.ndarray, "n 2 3"],
    corner: tuple[int, int],
    size: tuple[int, int],
) -> tuple[UInt8[np.ndarray, "m h w 3"], UInt8[np.ndarray, "m h w"]]:
    """Warp the pictures that touch a tile onto it."""
    height, width = pictures[0].shape[:2]
    stack, masks = [], []
    for picture, mask, to_plate in zip(pictures, visible, plate_from_frame, strict=True):
        to_tile = to_plate - np.array([[0, 0, corner[0]], [0, 0, corner[1]]])
        bounds = affine.apply(to_tile, np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]))
        if (bounds.max(0) <= 0).any() or (bounds.min(0) >= np.array(size)).any():
            continue
        matrix = affine.for_opencv(to_tile)
        stack.append(cv2.warpAffine(picture, matrix, size, borderMode=cv2.BORDER_REPLICATE))
        masks.append(255 * (cv2.warpAffine(mask, matrix, size) == 255).astype(np.uint8))
    return np.array(stack, np.uint8), np.array(masks, np.uint8)
