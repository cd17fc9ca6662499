"""The area that a part covers, cleaned for meshing: pinholes filled, specks dropped, islands bridged."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

SPECK_SHARE = 0.02
"""A speck is also smaller than this share of the part's largest island."""


@dataclass(frozen=True, eq=False)
class Silhouette:
    """A part's covered area inside a window of the canvas.

    ``mask`` is True inside, its first pixel is canvas pixel ``origin`` (x, y). ``drawn`` is what the drawing covers
    after specks are dropped, without filled holes and bridges. ``num_islands`` counts pieces before bridging,
    ``num_pieces`` after.
    """

    mask: Bool[np.ndarray, "H W"]
    drawn: Bool[np.ndarray, "H W"]
    origin: tuple[int, int]
    num_specks: int
    num_islands: int
    num_pieces: int
    num_holes: int


def silhouette_of(
    alpha: UInt8[np.ndarray, "H W"], *, least_alpha: int, pinhole: float, speck: float, bridge: float
) -> Silhouette | None:
    """Find the area that a part covers, or None where nothing reaches ``least_alpha``.

    Holes of an area below ``pinhole`` are filled; islands smaller than ``speck`` (pixels) and than 2 % of the largest
    one are dropped; islands closer than ``bridge`` pixels are joined by a thin band between their nearest points.
    """
    covered = alpha >= least_alpha
    if not covered.any():
        return None
    without_specks, num_specks = _drop_specks(covered, speck)
    window = _bounds(without_specks)
    drawn = without_specks[window]
    filled, num_holes = _fill_pinholes(drawn, pinhole)
    mask, num_islands, num_pieces = _bridge_islands(filled, bridge)
    origin = (window[1].start, window[0].start)
    return Silhouette(mask, drawn, origin, num_specks, num_islands, num_pieces, num_holes)


def _bounds(mask: Bool[np.ndarray, "H W"]) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _drop_specks(mask: Bool[np.ndarray, "H W"], speck: float) -> tuple[Bool[np.ndarray, "H W"], int]:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    keep = (areas >= speck) | (areas >= SPECK_SHARE * areas.max())
    if keep.all():
        return mask, 0
    kept = np.concatenate([[False], keep])[labels]
    return kept, int(count - 1 - keep.sum())


def _fill_pinholes(mask: Bool[np.ndarray, "H W"], pinhole: float) -> tuple[Bool[np.ndarray, "H W"], int]:
    """Fill small holes; returns the mask and how many larger holes stay open."""
    outside = np.pad(~mask, 1, constant_values=True).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(outside, connectivity=4)
    is_small = stats[:, cv2.CC_STAT_AREA] < pinhole
    is_small[[0, labels[0, 0]]] = False
    is_open = ~is_small
    is_open[[0, labels[0, 0]]] = False
    return mask | is_small[labels[1:-1, 1:-1]], int(is_open.sum())


def _bridge_islands(mask: Bool[np.ndarray, "H W"], bridge: float) -> tuple[Bool[np.ndarray, "H W"], int, int]:
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    islands = [_rim(labels == label) for label in range(1, count)]
    if len(islands) == 1:
        return mask, 1, 1
    gaps, ends = _nearest_points(islands)
    tree = minimum_spanning_tree(gaps).tocoo()
    bridged = mask.astype(np.uint8)
    num_pieces = len(islands)
    for a, b, gap in zip(tree.row, tree.col, tree.data, strict=True):
        if gap <= bridge:
            start, end = ends[min(a, b), max(a, b)]
            cv2.line(bridged, start, end, 1, thickness=3)
            num_pieces -= 1
    return bridged.astype(bool), len(islands), num_pieces


def _rim(mask: Bool[np.ndarray, "H W"]) -> Float[np.ndarray, "n 2"]:
    """List the (x, y) of the pixels of an island that have a neighbour outside."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    rows, columns = np.nonzero(mask & (inner == 0))
    return np.stack([columns, rows], axis=1).astype(np.float64)


Ends = tuple[tuple[int, int], tuple[int, int]]


def _nearest_points(
    islands: list[Float[np.ndarray, "_ 2"]],
) -> tuple[Float[np.ndarray, "I I"], dict[tuple[int, int], Ends]]:
    """Measure the gap between every two islands and find the two points that it lies between."""
    gaps = np.zeros((len(islands), len(islands)))
    ends: dict[tuple[int, int], Ends] = {}
    for a, rim in enumerate(islands):
        tree = cKDTree(rim)
        for b in range(a + 1, len(islands)):
            distance, index = tree.query(islands[b])
            nearest = int(distance.argmin())
            gaps[a, b] = distance[nearest]
            start, end = rim[index[nearest]], islands[b][nearest]
            ends[a, b] = (int(start[0]), int(start[1])), (int(end[0]), int(end[1]))
    return gaps, ends
