"""What the generator is trained on: each drawing as it is predicted from the others, cut into changed patches.

A handful of drawings is little to learn from, so each patch is mirrored, turned, scaled and coloured anew, input and
drawing alike. A step's patches depend on the seed, the step and their number alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, Int, UInt8
from torch import Tensor

from wildpuppet.machine import Progress, silent
from wildpuppet.refine.inputs import Method, look_for
from wildpuppet.refine.texture import Wardrobe, Weights

BORDER = 16
"""Pixels kept around what a drawing and its rendering show."""
TURN, ZOOM, GAIN = 0.2, 0.1, 0.2
"""Largest turn (radians), zoom (logarithm) and change of a colour channel (logarithm)."""
CHANGED = 0.6
"""Share of patches that are turned and scaled; resampling blurs them, so the others are left."""
PICTURES = 3
"""Channels come in premultiplied pictures of four, this many at most, then plain ones."""


class Pair(NamedTuple):
    """What is shown of a drawing and the drawing, cut to the character; values 0..255."""

    shown: UInt8[np.ndarray, "h w C"]
    drawn: UInt8[np.ndarray, "h w 4"]


class Batch(NamedTuple):
    """Patches, 0..1."""

    shown: Float[Tensor, "B C P P"]
    drawn: Float[Tensor, "B 4 P P"]


def pairs_of(
    wardrobe: Wardrobe, weights: Weights, method: Method, indices: Sequence[int], progress: Progress = silent
) -> list[Pair]:
    """Show each drawing as the other drawings predict it."""
    examples, pairs = wardrobe.examples, []
    for done, index in enumerate(indices):
        without = int(examples.drawing[index])
        found = wardrobe.find(examples.vertices[index], examples.order[index], without)
        shown = np.rint(255.0 * look_for(found, weights, method)[0]).clip(0, 255).astype(np.uint8)
        drawn = examples.rgba[index]
        window = window_of((shown[..., 3] > 0) | (drawn[..., 3] > 0))
        pairs.append(Pair(np.ascontiguousarray(shown[window]), np.ascontiguousarray(drawn[window])))
        progress(done + 1, len(indices))
    return pairs


def window_of(mask: np.ndarray) -> tuple[slice, slice]:
    """Bound what is marked, with a border; all of it where nothing is."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return slice(None), slice(None)
    top, left = max(int(rows[0]) - BORDER, 0), max(int(columns[0]) - BORDER, 0)
    return slice(top, int(rows[-1]) + 1 + BORDER), slice(left, int(columns[-1]) + 1 + BORDER)


def batch_of(pairs: Sequence[Pair], patch: int, count: int, random: np.random.Generator) -> Batch:
    """Draw ``count`` patches."""
    shown, drawn = [], []
    for _ in range(count):
        pair = pairs[int(random.integers(len(pairs)))]
        before, after = _patch(pair, patch, random)
        shown.append(before)
        drawn.append(after)
    return Batch(_tensor(shown), _tensor(drawn))


def _tensor(images: Sequence[Float32[np.ndarray, "P P C"]]) -> Float[Tensor, "B C P P"]:
    return torch.from_numpy(np.ascontiguousarray(np.stack(images).transpose(0, 3, 1, 2)))


def _patch(
    pair: Pair, patch: int, random: np.random.Generator
) -> tuple[Float32[np.ndarray, "P P C"], Float32[np.ndarray, "P P 4"]]:
    """Cut one patch whose middle lies on the character's window, and change it."""
    height, width = pair.drawn.shape[:2]
    middle = random.random(2) * (width, height)
    turn, zoom = (2.0 * random.random(2) - 1.0) * (TURN, ZOOM)
    is_changed, is_mirrored = random.random(2) < (CHANGED, 0.5)
    gains = np.exp((2.0 * random.random(3) - 1.0) * GAIN)
    if is_changed:
        pair_from_patch = _turned(middle, turn, np.exp(zoom), patch)
        shown, drawn = (_warped(image, pair_from_patch, patch) for image in pair)
    else:
        corner = np.round(middle - 0.5 * patch).astype(np.int64)
        shown, drawn = (_cut(image, corner, patch) for image in pair)
    if is_mirrored:
        shown, drawn = shown[:, ::-1], drawn[:, ::-1]
    return _coloured(shown, gains), _coloured(drawn, gains)


def _turned(middle: Float[np.ndarray, "2"], turn: float, zoom: float, patch: int) -> Float[np.ndarray, "2 3"]:
    """Map a patch's pixel indices to the pair's, turned about the middle."""
    cos, sin = zoom * np.cos(turn), zoom * np.sin(turn)
    linear = np.array([[cos, -sin], [sin, cos]])
    return np.column_stack([linear, middle - linear @ np.full(2, 0.5 * patch)])


def _warped(
    image: UInt8[np.ndarray, "h w C"], image_from_patch: Float[np.ndarray, "2 3"], patch: int
) -> Float32[np.ndarray, "P P C"]:
    """Resample; OpenCV takes four channels at a time."""
    groups = [
        np.atleast_3d(cv2.warpAffine(
            np.ascontiguousarray(image[..., first : first + 4], np.float32), image_from_patch, (patch, patch),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT, borderValue=0,
        ))
        for first in range(0, image.shape[2], 4)
    ]  # fmt: skip
    return np.asarray(np.concatenate(groups, -1) / 255.0, np.float32)


def _cut(image: UInt8[np.ndarray, "h w C"], corner: Int[np.ndarray, "2"], patch: int) -> Float32[np.ndarray, "P P C"]:
    """Cut without resampling; beyond the image there is nothing."""
    result = np.zeros((patch, patch, image.shape[2]), np.float32)
    height, width = image.shape[:2]
    left, top = corner.tolist()
    x0, x1, y0, y1 = max(left, 0), min(left + patch, width), max(top, 0), min(top + patch, height)
    if x1 > x0 and y1 > y0:
        result[y0 - top : y1 - top, x0 - left : x1 - left] = image[y0:y1, x0:x1] / np.float32(255.0)
    return result


def _coloured(image: Float32[np.ndarray, "P P C"], gains: Float[np.ndarray, "3"]) -> Float32[np.ndarray, "P P C"]:
    """Scale the colour channels of every premultiplied picture; none gets brighter than its alpha."""
    result = image.copy()
    for first in range(0, min(image.shape[2], 4 * PICTURES) - 3, 4):
        colour, alpha = image[..., first : first + 3], image[..., first + 3 : first + 4]
        result[..., first : first + 3] = np.minimum(colour * gains.astype(np.float32), alpha)
    return result
