"""Texture levels: the puppet's atlas at screen scale.

Sampling an atlas four times too fine costs much of a fit's accuracy, so each pyramid level draws from a texture whose
texels are about one screen pixel. Alpha must be 0 wherever a bilinear sample on a mesh border can reach, at every
level: otherwise the image jumps as the border moves and gradients are wrong in silence.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from scipy import sparse
from torch import Tensor

from wildpuppet.settings import PuppetSettings
from wildpuppet.types import Puppet


class Texture(NamedTuple):
    """One level. ``rgba`` is premultiplied, 0..1; ``uv`` are pixels of this level, corner origin."""

    rgba: Float[Tensor, "H W 4"]
    uv: Float[Tensor, "V 2"]


def texture_at(puppet: Puppet, scale: float, margin: float = PuppetSettings().margin) -> Texture:
    """Average the atlas to ``scale`` screen pixels per canvas pixel, with alpha 0 at and outside mesh borders.

    ``margin`` is how far the mesh reaches beyond the drawing, in canvas pixels. Where a screen pixel is wider than
    half of it, texels stay at half the margin and the average covers at most the margin, so that thin parts keep
    their width at coarse levels: a level of whole screen pixels would have to be cut back by up to one. Texels are
    never smaller than the atlas's own (a scale above 1 gives the atlas itself).
    Raises ValueError for a scale or margin that is not positive.
    """
    if not (scale > 0 and margin > 0):
        raise ValueError(f"scale and margin must be positive, not {scale} and {margin}")
    texel = max(1.0, min(1.0 / scale, margin / 2.0))
    width = max(1.0, min(1.0 / scale, margin))
    straight = puppet.atlas.astype(np.float32) / 255.0
    rgba = straight.copy()
    rgba[..., :3] *= straight[..., 3:]
    level = resample(rgba, 1.0 / texel, width)
    uv = puppet.uv.astype(np.float64) / texel
    level *= inside_by_a_texel(uv, puppet.triangles, level.shape[:2])[..., None]
    return Texture(torch.from_numpy(level), torch.from_numpy(uv.astype(np.float32)))


def resample(
    image: Float32[np.ndarray, "H W C"], scale: float, width: float | None = None
) -> Float32[np.ndarray, "h w C"]:
    """Average exactly over squares around each new pixel's centre; beyond the image counts as 0.

    ``width`` is the squares' side in old pixels, by default a new pixel's. The result has at least 2 by 2 pixels.
    """
    width = 1.0 / scale if width is None else width
    rows, columns = (_area_weights(count, scale, width) for count in image.shape[:2])
    by_rows = (rows @ image.reshape(len(image), -1)).reshape(rows.shape[0], *image.shape[1:])
    by_columns = columns @ by_rows.transpose(1, 0, 2).reshape(image.shape[1], -1)
    level = by_columns.reshape(columns.shape[0], rows.shape[0], -1).transpose(1, 0, 2)
    return np.ascontiguousarray(level, np.float32)


def _area_weights(count: int, scale: float, width: float) -> sparse.csr_array:
    """Share of each old pixel in each new one, (new, old)."""
    new_count = max(2, int(np.ceil(count * scale - 1e-9)))
    centres = (np.arange(new_count) + 0.5) / scale
    reach = np.arange(int(np.ceil(width)) + 1)
    old = np.floor(centres - width / 2).astype(int)[:, None] + reach
    overlap = np.minimum(centres[:, None] + width / 2, old + 1) - np.maximum(centres[:, None] - width / 2, old)
    keep = (old >= 0) & (old < count) & (overlap > 0)
    new = np.broadcast_to(np.arange(new_count)[:, None], old.shape)
    values = (overlap[keep] / width).astype(np.float32)
    return sparse.csr_array((values, (new[keep], old[keep])), (new_count, count))


def inside_by_a_texel(
    uv: Float[np.ndarray, "V 2"], triangles: Int[np.ndarray, "F 3"], shape: tuple[int, int]
) -> Bool[np.ndarray, "H W"]:
    """Find the texels that no bilinear sample on a mesh border can reach and that lie inside a mesh.

    A texel reaches the open square of two texels' side around its centre.
    """
    inside = np.zeros(shape, bool)
    for corners in uv[triangles]:
        window, x, y = _centres_near(corners, shape)
        inside[window] |= _in_triangle(corners, x, y)
    for ends in uv[border_edges(triangles)]:
        window, x, y = _centres_near(ends, shape)
        along = ends[1] - ends[0]
        distance = np.abs((x - ends[0, 0]) * along[1] - (y - ends[0, 1]) * along[0])
        inside[window] &= distance >= np.abs(along).sum()
    return inside


def border_edges(triangles: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "E 2"]:
    """Edges that belong to one triangle only."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    border: Int[np.ndarray, "E 2"] = unique[counts == 1]
    return border


def _centres_near(
    points: Float[np.ndarray, "n 2"], shape: tuple[int, int]
) -> tuple[tuple[slice, slice], Float[np.ndarray, "1 w"], Float[np.ndarray, "h 1"]]:
    """Find the window of texel centres less than a texel from the points' bounding box."""
    first = np.maximum(np.floor(points.min(0) - 1.5).astype(int) + 1, 0)
    end = np.clip(np.ceil(points.max(0) + 0.5).astype(int), first, np.maximum(first, shape[::-1]))
    x, y = (np.arange(first[axis], end[axis]) + 0.5 for axis in range(2))
    return (slice(first[1], end[1]), slice(first[0], end[0])), x[None, :], y[:, None]


def _in_triangle(
    corners: Float[np.ndarray, "3 2"], x: Float[np.ndarray, "1 w"], y: Float[np.ndarray, "h 1"]
) -> Bool[np.ndarray, "h w"]:
    """Test centres against a triangle of either orientation, edges included."""
    sides = [
        (x - a[0]) * (b[1] - a[1]) - (y - a[1]) * (b[0] - a[0])
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    low, high = np.minimum.reduce(sides), np.maximum.reduce(sides)
    return np.asarray((low >= 0) | (high <= 0))
