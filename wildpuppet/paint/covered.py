"""What stands in front of the character without being part of the puppet: paint must not go over it.

A pixel shows something else where its colour is outside all that the puppet has within a few pixels (a fit that is a
little off, a line that is thicker, does not count) and no colour of the part at all (an eye that closes, a mouth that
opens does not count either). What is left is cleaned of specks and grown up to where the part is seen again.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

from wildpuppet.paint.layers import Drawn
from wildpuppet.puppet.atlas import layer_picture
from wildpuppet.types import Puppet

FOREIGN = 0.16
"""Distance (0..1, one channel) beyond the puppet's own colours from which a pixel shows something else."""
SPECK = 3
"""Pixels across: smaller things are grain."""
LEVELS = 32
"""Steps per channel in which a part's colours are counted."""
LEAST_SHARE = 0.003
"""Share of a part that a colour covers at least to count as the part's."""

Colours = Float32[np.ndarray, "h w 3"]


class Palettes:
    """The colours of each part's unpainted texture, and those near them."""

    def __init__(self, puppet: Puppet) -> None:
        self._near = np.stack([_near(_texels(puppet, layer)) for layer in range(puppet.num_layers)])

    def holds(self, colours: Colours, layer: Int[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        """Tell for each pixel whether its colour is one of the part there; it is not where no part is."""
        steps = np.clip((colours * LEVELS).astype(np.int64), 0, LEVELS - 1)
        found = self._near[np.maximum(layer, 0), steps[..., 0], steps[..., 1], steps[..., 2]]
        return np.asarray(found & (layer >= 0))


def _texels(puppet: Puppet, layer: int) -> Int[np.ndarray, "n 3"]:
    window, _ = layer_picture(puppet, layer)
    return window[window[..., 3] >= 128][:, :3].astype(np.int64)


def _near(texels: Int[np.ndarray, "n 3"]) -> Bool[np.ndarray, "r g b"]:
    """Mark the steps of colour that lie near a common colour of a part."""
    counts = np.zeros((LEVELS,) * 3, np.int64)
    np.add.at(counts, tuple((texels * LEVELS // 256).T), 1)
    common = (counts >= max(1.0, LEAST_SHARE * len(texels))).astype(np.uint8)
    reach = 2 * int(FOREIGN * LEVELS) + 1
    for axis in range(3):  # a cube around each, one axis after the other
        rows = np.moveaxis(common, axis, 0).reshape(LEVELS, -1)
        grown = cv2.dilate(np.ascontiguousarray(rows), np.ones((reach, 1), np.uint8))
        common = np.moveaxis(np.asarray(grown, np.uint8).reshape(LEVELS, LEVELS, LEVELS), 0, axis)
    return common > 0


def uncovered(
    frame: Colours, model: Colours, drawn: Drawn, palettes: Palettes, light: tuple[float, float, float], reach: int
) -> Float32[np.ndarray, "h w"]:
    """Give how far the frame shows the puppet at each pixel: 1, falling to 0 where something else covers it."""
    size = 2 * (reach + 1) + 1
    around = np.ones((size, size), np.uint8)
    smooth = cv2.GaussianBlur(frame, (0, 0), 0.8)
    is_strange = ~palettes.holds(smooth / np.array(light, np.float32), drawn.layer) & (drawn.before[..., 3] > 0.5)
    beside = np.maximum(cv2.erode(model, around) - smooth, smooth - cv2.dilate(model, around)).max(-1)
    foreign = (is_strange & (beside > FOREIGN)).astype(np.uint8)
    speck = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (SPECK, SPECK))
    sure = cv2.morphologyEx(foreign, cv2.MORPH_OPEN, speck)
    if not sure.any():
        return np.ones(sure.shape, np.float32)
    unlike = is_strange & (np.abs(smooth - model).max(-1) > FOREIGN)
    covered = _grown(sure, unlike | (drawn.before[..., 3] <= 0.5), 2 * reach + 3)
    closed = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, speck)
    return np.asarray(1.0 - closed.astype(np.float32), np.float32)


def _grown(start: np.ndarray, allowed: Bool[np.ndarray, "h w"], steps: int) -> np.ndarray:
    """Grow a mask step by step where it is allowed to."""
    reached = start
    for _ in range(steps):
        reached = np.maximum(start, cv2.dilate(reached, np.ones((3, 3), np.uint8)) * allowed)
    return reached
