"""Crops of a folder of unordered drawings: the paper's own case, no tracking, one canvas, one window for all."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.crop.warp import cut_window
from wildpuppet.crop.window import even
from wildpuppet.errors import InputError
from wildpuppet.geometry import affine
from wildpuppet.settings import CropSettings
from wildpuppet.types import Crops, Images, TrackState

# Mattes above this are drawing.
DRAWN = 128
FOLLOWED: TrackState = "followed"
BLOCK = 8


def crops_of_drawings(names: Sequence[str], images: Images, size: tuple[int, int], settings: CropSettings) -> Crops:
    """Lay one window over all drawings: the bounding box of all mattes and a margin.

    The largest character's larger side becomes ``settings.box_pixels`` crop pixels, or stays where the drawings are
    smaller than that. ``video_from_crop`` takes crop pixels to drawing pixels. Raises InputError, naming the file,
    for a drawing with an empty matte.
    """
    if len(images) == 0 or len(names) != len(images):
        found = f"{len(images)} drawings, {len(names)} names"
        raise InputError(f"expected one or more drawings with a name each, found {found}")
    boxes = drawn_boxes(names, images)
    low, high = boxes[:, :2].min(0), (boxes[:, :2] + boxes[:, 2:]).max(0)
    side = float(boxes[:, 2:].max())
    scale = min(1.0, settings.box_pixels / side)
    margin = settings.margin * side
    window = even((high - low + 2 * margin) * scale)
    corner = (low + high) / 2 - 0.5 * np.array(window) / scale
    one = affine.scale_and_shift(1.0 / scale, (float(np.round(corner[0])), float(np.round(corner[1]))))
    video_from_crop = np.repeat(one[None], len(images), 0)
    frames = np.arange(len(images))
    return Crops(
        frames=frames,
        size=window,
        video_from_crop=video_from_crop,
        images=DrawingImages(images, one, window),
        box_crop=np.concatenate([(boxes[:, :2] - one[:, 2]) * scale, boxes[:, 2:] * scale], 1),
        drawing=frames.copy(),
        shot=np.zeros(len(images), np.int64),
        state=tuple(FOLLOWED for _ in range(len(images))),
        reference=None,
        ordered=False,
    )


def drawn_boxes(names: Sequence[str], images: Images) -> Float[np.ndarray, "T 4"]:
    """Bound each drawing's matte, x y w h in drawing pixels."""
    boxes = np.empty((len(images), 4))
    for start in range(0, len(images), BLOCK):
        for row, image in enumerate(images[start : start + BLOCK], start):
            box = bounds(image[..., 3] > DRAWN)
            if box is None:
                raise InputError(
                    f"{names[row]}: expected a drawing with a background that is transparent or one plain colour, "
                    "found nothing drawn; mend or remove it"
                )
            boxes[row] = box
    return boxes


def bounds(mask: np.ndarray) -> Int[np.ndarray, "4"] | None:
    """Bound the marked pixels: x, y, w, h; None where there are none."""
    columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    if len(columns) == 0:
        return None
    return np.array([columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]])


class DrawingImages:
    """Drawings seen through one window, lazily; beyond the canvas the colour is the edge's and the matte is 0."""

    def __init__(self, images: Images, video_from_crop: Float[np.ndarray, "2 3"], size: tuple[int, int]) -> None:
        self._images, self._video_from_crop, self._size = images, video_from_crop, size

    def __len__(self) -> int:
        return len(self._images)

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        drawings = self._images[index]
        return np.stack([self._cut(drawing) for drawing in drawings]) if len(drawings) else self._none()

    def _none(self) -> UInt8[np.ndarray, "n H W 4"]:
        return np.empty((0, self._size[1], self._size[0], 4), np.uint8)

    def _cut(self, drawing: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "h w 4"]:
        """Cut one drawing; straight colour is weighted by alpha where it is resampled, so no fringe appears."""
        colour = cut_window(np.ascontiguousarray(drawing[..., :3]), self._video_from_crop, self._size)
        border = cv2.copyMakeBorder(drawing[..., 3], 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
        bordered_from_crop = self._video_from_crop + np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
        matte = cut_window(border, bordered_from_crop, self._size)
        return np.dstack([colour, matte])
