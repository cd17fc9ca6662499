"""One texture for all parts: windows of the part pictures packed on shelves, colour bled past the edge.

Texels keep the canvas's scale and grid (whole-pixel translations), so that the atlas at rest is the drawing itself.
Alpha is 0 in every texel that a sample on a mesh border can touch: otherwise the rendered picture is not continuous in
the vertices and its gradient is wrong.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

from wildpuppet.types import Puppet

PADDING = 8
"""Least number of texels between a mesh and its window's border, so between two meshes twice as many."""
SURE_ALPHA = 64
"""Colour of a texel with less alpha than this is taken from the nearest one with more."""


def layer_picture(puppet: Puppet, layer: int) -> tuple[UInt8[np.ndarray, "h w 4"], Float[np.ndarray, "2"]]:
    """Cut a built puppet's layer out of its atlas; gives the picture and its corner on the canvas."""
    mine = puppet.layer_of_vertex == layer
    uv = puppet.uv[mine]
    low, high = np.floor(uv.min(0)).astype(int).clip(0), np.ceil(uv.max(0)).astype(int)
    corner: Float[np.ndarray, "2"] = low + (puppet.vertices[mine][0] - uv[0])
    return puppet.atlas[low[1] : high[1], low[0] : high[0]], corner


def shelf_pack(sizes: Int[np.ndarray, "L 2"]) -> tuple[tuple[int, int], Int[np.ndarray, "L 2"]]:
    """Place rectangles (w, h) on shelves, tallest first; returns the whole (W, H) and each one's corner (x, y)."""
    corners = np.zeros_like(sizes)
    width = max(int(sizes[:, 0].max()), int(np.ceil(np.sqrt(np.prod(sizes.astype(np.float64), axis=1).sum()) * 1.1)))
    x, y, shelf, used = 0, 0, 0, 0
    for index in np.argsort(-sizes[:, 1], kind="stable"):
        w, h = (int(side) for side in sizes[index])
        if x + w > width:
            x, y, shelf = 0, y + shelf, 0
        corners[index] = x, y
        x, shelf, used = x + w, max(shelf, h), max(used, x + w)
    return (used, y + shelf), corners


def window_of(vertices: Float[np.ndarray, "V 2"]) -> tuple[int, int, int, int]:
    """Find the canvas window x, y, w, h that holds a mesh and the padding around it."""
    low = np.floor(vertices.min(axis=0)).astype(int) - PADDING
    high = np.ceil(vertices.max(axis=0)).astype(int) + PADDING
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def cut_window(rgba: UInt8[np.ndarray, "H W 4"], window: tuple[int, int, int, int]) -> UInt8[np.ndarray, "h w 4"]:
    """Copy a window that may reach beyond the picture; there it is transparent black."""
    x, y, w, h = window
    height, width = rgba.shape[:2]
    cut = np.zeros((h, w, 4), np.uint8)
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + w, width), min(y + h, height)
    if x1 > x0 and y1 > y0:
        cut[y0 - y : y1 - y, x0 - x : x1 - x] = rgba[y0:y1, x0:x1]
    return cut


def border_texels(
    shape: tuple[int, int], starts: Float[np.ndarray, "B 2"], ends: Float[np.ndarray, "B 2"]
) -> Bool[np.ndarray, "h w"]:
    """Mark the texels that bilinear samples along segments (corner origin) touch, and their neighbours."""
    touched = np.zeros(shape, bool)
    for start, end in zip(starts, ends, strict=True):
        count = int(np.ceil(np.linalg.norm(end - start) * 4.0)) + 1
        points = start + (end - start) * np.linspace(0.0, 1.0, count)[:, None]
        x, y = np.floor(points - 0.5).astype(int).T
        for shift_x, shift_y in ((0, 0), (1, 0), (0, 1), (1, 1)):
            touched[np.clip(y + shift_y, 0, shape[0] - 1), np.clip(x + shift_x, 0, shape[1] - 1)] = True
    grown: Bool[np.ndarray, "h w"] = ndimage.binary_dilation(touched)
    return grown


def bleed(rgba: UInt8[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "h w 4"]:
    """Give every texel with little alpha the colour of the nearest sure one; alpha stays."""
    alpha = rgba[..., 3]
    sure = alpha >= min(SURE_ALPHA, int(alpha.max()))
    _, (rows, columns) = ndimage.distance_transform_edt(~sure, return_indices=True)
    bled = rgba.copy()
    bled[..., :3] = rgba[rows, columns, :3]
    return bled


def assemble(
    size: tuple[int, int], windows: Sequence[UInt8[np.ndarray, "_ _ 4"]], corners: Int[np.ndarray, "L 2"]
) -> UInt8[np.ndarray, "H W 4"]:
    """Lay the windows into one picture; texels of no window are transparent black."""
    atlas = np.zeros((size[1], size[0], 4), np.uint8)
    for window, (x, y) in zip(windows, corners, strict=True):
        atlas[y : y + window.shape[0], x : x + window.shape[1]] = window
    return atlas
