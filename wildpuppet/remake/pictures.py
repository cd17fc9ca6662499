"""The pictures around poses: which part of the plane is drawn, and the two pictures that a model is to read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.crop.drawings import DRAWN, DrawingImages, bounds
from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import scale_and_shift
from wildpuppet.settings import CropSettings
from wildpuppet.video.drawings import read_drawing

MARGIN = 0.06
"""Room around the character, as a share of its larger side, where it is drawn closely."""


def framed(
    vertices: Float[np.ndarray, "T V 2"], shape: tuple[int, int], size: int, closely: bool
) -> tuple[Float[np.ndarray, "2 3"], tuple[int, int]]:
    """Choose the picture: the map into it and its (W, H), of which the larger is ``size``.

    It is the whole picture of ``shape``, or with ``closely`` the box around all of ``vertices``.
    """
    low, high = np.zeros(2), np.array(shape, np.float64)
    if closely:
        low, high = vertices.min((0, 1)), vertices.max((0, 1))
        room = MARGIN * float((high - low).max())
        low, high = low - room, high + room
    scale = size / float((high - low).max())
    width, height = (max(1, round(float(side) * scale)) for side in high - low)
    return scale_and_shift(scale, (float(-low[0] * scale), float(-low[1] * scale))), (width, height)


def read_pair(
    paths: Sequence[Path], size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "2 h w 4"], Float[np.ndarray, "2 3"], tuple[int, int]]:
    """Read two pictures of a character through one window of ``size``, as a model saw its drawings.

    Gives the crops, the map from crop to picture pixels, and the pictures' (W, H).
    """
    drawings = [read_drawing(path) for path in paths]
    shapes = [drawing.shape[1::-1] for drawing in drawings]
    if shapes[0] != shapes[1]:
        found = " and ".join(f"{width}x{height}" for width, height in shapes)
        raise InputError(f"{paths[1]}: expected two pictures of one size, found {found}")
    boxes = [bounds(drawing[..., 3] > DRAWN) for drawing in drawings]
    for path, box in zip(paths, boxes, strict=True):
        if box is None:
            raise InputError(f"{path}: expected a drawing, found nothing drawn")
    corners = np.array([[box[:2], box[:2] + box[2:]] for box in boxes if box is not None], np.float64)
    side = max(float(box[2:].max()) for box in boxes if box is not None)
    scale = min(1.0, CropSettings().box_pixels / side)
    middle = (corners.min((0, 1)) + corners.max((0, 1))) / 2.0
    shift = middle - np.array(size, np.float64) / 2.0 / scale
    picture_from_crop = scale_and_shift(1.0 / scale, (float(shift[0]), float(shift[1])))
    images = DrawingImages(np.stack(drawings), picture_from_crop, size)[0:2]
    return images, picture_from_crop, (int(shapes[0][0]), int(shapes[0][1]))
