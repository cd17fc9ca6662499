"""Which share of each pixel lies inside an outline: exact along x, the mean of a few scan lines along y.

An outline is one ring or several: further pieces, and holes. Points are in frame pixels, corner origin.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

Rule = Literal["evenodd", "nonzero"]
"""What is inside where rings overlap: evenodd counts crossings, nonzero their directions (as in SVG)."""

_SCAN_LINES = 8
"""Scan lines per pixel that coverage is the mean of; with exact columns this is finer than any drawn edge."""
_MOST_TESTS = 2**22
"""Edges times scan lines that are looked at in one go; bounds the memory."""


def polygon_coverage(points: Float[np.ndarray, "N 2"], canvas: tuple[int, int]) -> Float[np.ndarray, "H W"]:
    """Measure which share of each pixel lies inside one ring, by the even-odd rule."""
    return rings_coverage([points], canvas)


def rings_coverage(
    rings: Sequence[Float[np.ndarray, "_ 2"]], canvas: tuple[int, int], rule: Rule = "evenodd"
) -> Float[np.ndarray, "H W"]:
    """Measure which share of each pixel (0..1) lies inside rings; what is outside the canvas is cut off."""
    width, height = canvas
    coverage = np.zeros((height, width))
    points = np.concatenate(rings)
    left, top = (int(edge) for edge in np.clip(np.floor(points.min(0)), 0, canvas))
    right, bottom = (int(edge) for edge in np.clip(np.ceil(points.max(0)), 0, canvas))
    if right <= left or bottom <= top:
        return coverage
    edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    band = max(1, _MOST_TESTS // (_SCAN_LINES * len(edges)))
    for row in range(top, bottom, band):
        rows = min(band, bottom - row)
        scan_y = row + (np.arange(rows * _SCAN_LINES) + 0.5) / _SCAN_LINES
        line, x, weight = _crossings(edges, scan_y, rule)
        inside = _spans(line, x - left, weight, (len(scan_y), right - left))
        coverage[row : row + rows, left:right] = inside.reshape(rows, _SCAN_LINES, -1).mean(1)
    return coverage


def _crossings(
    edges: Float[np.ndarray, "E 2 2"], scan_y: Float[np.ndarray, "S"], rule: Rule
) -> tuple[Int[np.ndarray, "C"], Float[np.ndarray, "C"], Int[np.ndarray, "C"]]:
    """Find where scan lines cross edges: the line, x, and -1 where the inside begins, 1 where it ends, 0 within."""
    (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
    line, edge = np.nonzero((y0 <= scan_y[:, None]) != (y1 <= scan_y[:, None]))
    x = x0[edge] + (scan_y[line] - y0[edge]) * (x1[edge] - x0[edge]) / (y1[edge] - y0[edge])
    by_place = np.lexsort((x, line))
    line, edge, x = line[by_place], edge[by_place], x[by_place]
    turn = np.where(y1[edge] > y0[edge], 1, -1) if rule == "nonzero" else np.ones(len(x), np.int64)
    # Every ring crosses a line an even number of times, and as often up as down: the count starts anew on each line.
    after = np.cumsum(turn)
    before = after - turn
    if rule == "evenodd":
        after, before = after % 2, before % 2
    weight = (before != 0).astype(np.int64) - (after != 0)
    return line, x, weight


def _spans(
    line: Int[np.ndarray, "C"], x: Float[np.ndarray, "C"], weight: Int[np.ndarray, "C"], shape: tuple[int, int]
) -> Float[np.ndarray, "S W"]:
    """Add up, per scan line, the share of each pixel to the left of each crossing, times its weight."""
    lines, width = shape
    x = np.clip(x, 0, width)
    column = np.floor(x).astype(np.int64)
    place = line * (width + 1) + column
    share = np.bincount(place, weight * (x - column), minlength=lines * (width + 1)).reshape(lines, -1)[:, :width]
    ends = np.bincount(place, weight, minlength=lines * (width + 1)).reshape(lines, -1)
    inside: Float[np.ndarray, "S W"] = share + np.cumsum(ends[:, ::-1], axis=1)[:, ::-1][:, 1:]
    return inside
