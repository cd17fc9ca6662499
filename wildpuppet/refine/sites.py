"""Carrying what a drawing shows to another pose, through the puppet's surface.

Each pixel that shows the puppet lies on one triangle; a pixel beside it, up to ``reach`` away, is written with the
nearest such triangle's barycentrics continued beyond its edge. So a thick outline, a lock of hair that the puppet
lacks or the paper inside an outline that the puppet crosses are carried along too. A drawing has seen a site where its
own puppet shows the same part there, or for a pixel beside the puppet nothing.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from wildpuppet.refine.figure import Drawn
from wildpuppet.types import Puppet

ROW = 256
"""Sites per row of the table that OpenCV resamples by; it takes no rows longer than 32,767."""
LEAST_AREA = 1e-3
PART_BITS = 62
SLACK = 1
"""Pixels by which the place where a part is seen may be off."""


class Sites(NamedTuple):
    """Pixels on and beside the puppet: place in the picture, corners and weights, layer; ``beside``: how far off it."""

    rows: Int[np.ndarray, "n"]
    columns: Int[np.ndarray, "n"]
    corners: Int[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n 3"]
    layer: Int[np.ndarray, "n"]
    beside: Float[np.ndarray, "n"]


def sites_of(puppet: Puppet, vertices: Float[np.ndarray, "V 2"], drawn: Drawn, reach: float) -> Sites:
    """List the pixels within ``reach`` of a drawn pose."""
    empty = drawn.triangle < 0
    if empty.all():
        none = np.zeros(0, np.int64)
        return Sites(none, none, np.zeros((0, 3), np.int64), np.zeros((0, 3)), none, np.zeros(0))
    away, label = cv2.distanceTransformWithLabels(
        empty.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    triangle_of = np.zeros(int(label.max()) + 1, np.int64)
    triangle_of[label[~empty]] = drawn.triangle[~empty]
    rows, columns = np.nonzero(away <= reach)
    triangle = triangle_of[label[rows, columns]]
    corners = puppet.triangles[triangle].astype(np.int64)
    centres = np.stack([columns, rows], 1) + 0.5
    weights = _mix(vertices[corners].astype(np.float64), centres)
    layer = puppet.layer_of_triangle[triangle].astype(np.int64)
    return Sites(rows, columns, corners, weights, layer, away[rows, columns].astype(np.float64))


def _mix(corners: Float[np.ndarray, "n 3 2"], points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Write points as mixes of corners; a triangle without area counts as a small one."""
    first, second, offset = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(np.abs(area) < LEAST_AREA, np.where(area < 0.0, -LEAST_AREA, LEAST_AREA), area)
    v = (offset[:, 0] * second[:, 1] - offset[:, 1] * second[:, 0]) / area
    w = (first[:, 0] * offset[:, 1] - first[:, 1] * offset[:, 0]) / area
    return np.stack([1.0 - v - w, v, w], 1)


def carried(
    sites: Sites,
    vertices: Float[np.ndarray, "V 2"],
    picture: Float32[np.ndarray, "H W 4"],
    seen: Int[np.ndarray, "H W"],
) -> tuple[Float32[np.ndarray, "n 4"], Bool[np.ndarray, "n"]]:
    """Look up the sites in another drawing with its puppet at ``vertices``: colours, and whether it shows them.

    ``seen`` is that drawing's ``visibility``. Beyond the picture there is nothing (0), and nothing is seen.
    """
    places = np.einsum("nkd,nk->nd", vertices[sites.corners].astype(np.float64), sites.weights)
    height, width = picture.shape[:2]
    near = np.clip(np.nan_to_num(places), -2.0, [width + 2.0, height + 2.0])
    column, row = (np.floor(near[:, axis]).astype(np.int64) for axis in range(2))
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    bits = seen[row.clip(0, height - 1), column.clip(0, width - 1)]
    wanted = np.where(sites.beside > 0.0, np.int64(1), _bit(sites.layer))
    return _sampled(picture, near), inside & ((bits & wanted) != 0)


def visibility(layer: Int[np.ndarray, "H W"]) -> Int[np.ndarray, "H W"]:
    """Say which parts are seen at or right beside each pixel: bit 0 for none of them, bits 1 to 62 for parts."""
    bits = np.where(layer < 0, np.int64(1), _bit(layer))
    padded = np.pad(bits, SLACK, constant_values=1)
    height, width = layer.shape
    found = np.zeros_like(bits)
    for down in range(2 * SLACK + 1):
        for right in range(2 * SLACK + 1):
            found |= padded[down : down + height, right : right + width]
    return found


def _bit(layer: Int[np.ndarray, "*shape"]) -> Int[np.ndarray, "*shape"]:
    """Give a part's bit; from part 62 on they are shared."""
    return np.asarray(np.int64(1) << (1 + np.maximum(layer, 0).astype(np.int64) % PART_BITS))


def _sampled(picture: Float32[np.ndarray, "H W 4"], places: Float[np.ndarray, "n 2"]) -> Float32[np.ndarray, "n 4"]:
    """Sample bilinearly at corner-origin places."""
    count = len(places)
    flat_places = np.zeros((-(-count // ROW) * ROW, 2), np.float32)
    flat_places[:count] = places - 0.5
    at = flat_places.reshape(-1, ROW, 2)
    flat = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(flat, np.float32).reshape(-1, picture.shape[2])[:count]
