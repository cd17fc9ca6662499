"""The drawn edge of each part, carried by its mesh: what programs call a mask, a spline or a rotoscope.

The edge is where the texture is half opaque, found once at rest; every point of it is a mix of three corners of the
mesh and goes with them, so that an outline has the same points in every frame. Holes are left out, and so are islands
that are small beside the part.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from skimage.measure import find_contours

from wildpuppet.correspond import cover
from wildpuppet.export.sprites import atlas_window
from wildpuppet.types import Puppet

TOLERANCE = 0.35
"""How far, in texels, the outline's straight pieces may be from the edge. Lower has more points."""
LEAST_SHARE = 0.02
"""Islands with less than this share of the part's largest are left out."""
LEAST_POINTS = 3


class Outline(NamedTuple):
    """A closed outline: its points as mixes of the puppet's vertices."""

    layer: int
    corners: Int[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n 3"]

    def at(self, vertices: Float[np.ndarray, "V 2"]) -> Float[np.ndarray, "n 2"]:
        """Place the points."""
        return np.asarray(np.einsum("nkd,nk->nd", vertices[self.corners].astype(np.float64), self.weights))


def outlines(puppet: Puppet, layer: int) -> list[Outline]:
    """Find a part's outlines, the largest first; none where nothing is drawn."""
    window = atlas_window(puppet, layer)
    alpha = puppet.atlas[window.y : window.y + window.height, window.x : window.x + window.width, 3]
    found = (_anchored(puppet, layer, loop + window[:2]) for loop in edge_of(alpha))
    return [outline for outline in found if len(outline.corners) >= LEAST_POINTS]


def edge_of(alpha: UInt8[np.ndarray, "h w"]) -> list[Float[np.ndarray, "_ 2"]]:
    """Trace where alpha is half of 255 around what is opaque, corner origin, the largest outline first."""
    padded = np.pad(alpha.astype(np.float64), 1)
    traced = find_contours(padded, 127.5)  # type: ignore[no-untyped-call]
    loops = [loop[:-1, ::-1] - 0.5 for loop in traced if (loop[0] == loop[-1]).all()]
    areas = [_area(loop) for loop in loops]
    largest = max(areas, key=abs, default=0.0)
    kept = [
        (area / largest, loop) for area, loop in zip(areas, loops, strict=True) if area / largest >= LEAST_SHARE
    ]  # holes run the other way round
    kept.sort(key=lambda pair: -pair[0])
    return [_simplified(loop) for _, loop in kept]


def _area(loop: Float[np.ndarray, "n 2"]) -> float:
    after = np.roll(loop, -1, axis=0)
    return float((loop[:, 0] * after[:, 1] - loop[:, 1] * after[:, 0]).sum() / 2.0)


def _simplified(loop: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
    few = cv2.approxPolyDP(loop.astype(np.float32)[:, None], TOLERANCE, True)
    return np.asarray(few[:, 0], np.float64)


def _anchored(puppet: Puppet, layer: int, points: Float[np.ndarray, "n 2"]) -> Outline:
    """Tie points of the atlas to the triangles of the layer that they lie on."""
    wanted = np.full(len(points), layer, np.int64)
    rank = np.arange(puppet.num_layers, dtype=np.float64)
    uv = puppet.uv.astype(np.float64)
    triangle = cover.frontmost(
        uv, puppet.triangles, puppet.layer_of_triangle, rank, uv, puppet.atlas[..., 3], points, wanted
    )
    on = triangle >= 0
    corners = puppet.triangles[triangle[on]].astype(np.int64)
    return Outline(layer, corners, cover.barycentrics(uv, corners, points[on]))
