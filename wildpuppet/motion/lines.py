"""How far two drawings' lines are from one another: the Chamfer distance between their edges.

Lines are what Canny finds in the grey picture over white paper: an ink line gives both of its sides, a border of
colours one edge. The distance is the mean, over both pictures, of how far a line pixel is from the other's nearest.
"""

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.render.render import Mesh, Texture, render

LOW, HIGH = 60.0, 140.0
"""Canny's thresholds on 0..255 grey."""


def lines_of(picture: UInt8[np.ndarray, "H W 3"]) -> Bool[np.ndarray, "H W"]:
    """Find the line pixels of an RGB picture."""
    return np.asarray(cv2.Canny(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), LOW, HIGH) > 0)


def chamfer(first: Bool[np.ndarray, "H W"], second: Bool[np.ndarray, "H W"]) -> float:
    """Give the mean distance between the lines, both ways, in pixels; NaN where one has no lines."""
    if not (first.any() and second.any()):
        return float("nan")
    return (_mean_distance(first, second) + _mean_distance(second, first)) / 2.0


def _mean_distance(lines: Bool[np.ndarray, "H W"], others: Bool[np.ndarray, "H W"]) -> float:
    distance = cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5)
    return float(distance[lines].mean())


def drawn_on_white(
    mesh: Mesh,
    texture: Texture,
    vertices: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
    size: tuple[int, int],
) -> UInt8[np.ndarray, "H W 3"]:
    """Render one pose over white paper."""
    with torch.no_grad():
        posed, stacked = (
            torch.from_numpy(vertices[None].astype(np.float32)),
            torch.from_numpy(order[None].copy()).long(),
        )
        rgba = render(posed, mesh, texture, stacked, size).rgba[0].numpy()
    white = rgba[..., :3] + (1.0 - rgba[..., 3:])
    return np.asarray(np.clip(white * 255.0 + 0.5, 0.0, 255.0), np.uint8)
