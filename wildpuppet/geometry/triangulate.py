"""Quality triangulation of polygons with holes: constrained Delaunay with Ruppert refinement, by PythonCDT.

The boundary is split so that no edge is longer than asked, then triangles are refined until their smallest angle and
their area are within bounds. With smallest angle A and the area of an equilateral triangle of side ``edge``, no edge
exceeds about twice ``edge``.
"""

from collections.abc import Sequence

import numpy as np
import pythoncdt
from jaxtyping import Float, Int

from wildpuppet.geometry.topology import signed_areas

Ring = Float[np.ndarray, "_ 2"]

SHORTEST_EDGE_SHARE = 0.1
"""Refinement makes no edge shorter than this share of the target: it stops at corners too sharp for the angle."""
MOST_VERTICES = 200_000


def triangulate(
    rings: Sequence[Ring], *, edge: float, least_angle: float = 25.0
) -> tuple[Float[np.ndarray, "V 2"], Int[np.ndarray, "F 3"]]:
    """Triangulate the area that rings enclose by the even-odd rule: outer borders and holes in any order or direction.

    ``edge`` is the target length: boundary edges are at most this, triangles at most the equilateral triangle's area.
    ``least_angle`` in degrees is what refinement aims for (at most 30); only corners of the rings that are sharper, and
    places where two borders come closer than a fraction of ``edge``, keep smaller angles. Triangles turn from x towards
    y (clockwise on screen).

    Raises:
        ValueError: no ring encloses an area, or a coordinate is not finite.
    """
    clean = [_without_repeats(np.asarray(ring, np.float64)) for ring in rings]
    clean = [ring for ring in clean if len(ring) >= 3]
    if not clean or not all(np.isfinite(ring).all() for ring in clean):
        raise ValueError("triangulate: expected at least one ring of three distinct finite points")
    split = [_split_edges(ring, edge) for ring in clean]
    points = np.concatenate(split)
    mesh = _constrained(points, _ring_edges(split))
    outside = mesh.collect_outer_triangles_and_holes()
    _refine(mesh, outside, edge, least_angle, MOST_VERTICES)
    mesh.finalize_triangulation(outside)
    raw = mesh.vertices_array()
    vertices = np.stack([raw["x"], raw["y"]], axis=-1).astype(np.float64)
    return _compact(vertices, mesh.triangles_array()["vertices"].astype(np.int64))


def _constrained(points: Float[np.ndarray, "n 2"], edges: Int[np.ndarray, "n 2"]) -> pythoncdt.Triangulation:
    mesh = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.TRY_RESOLVE, 0.0
    )
    unique, index = np.unique(points, axis=0, return_inverse=True)
    edges = index.reshape(-1)[edges]
    # numpy announces the buffer protocol to type checkers from Python 3.12 on, hence the two ignores
    mesh.insert_vertices(np.ascontiguousarray(unique))  # type: ignore[call-overload]
    edges = np.ascontiguousarray(edges[edges[:, 0] != edges[:, 1]], dtype=np.uint32)
    mesh.insert_edges(edges)  # type: ignore[call-overload]
    return mesh


def _refine(mesh: pythoncdt.Triangulation, outside: set[int], edge: float, least_angle: float, most: int) -> None:
    """Refine by angle, then area, then angle again: new points of the area pass may have made thin triangles."""
    by_angle, by_area = pythoncdt.RefinementCriterion.SMALLEST_ANGLE, pythoncdt.RefinementCriterion.LARGEST_AREA
    area, radians, shortest = np.sqrt(3.0) / 4.0 * edge**2, np.radians(least_angle), SHORTEST_EDGE_SHARE * edge
    for criterion, threshold in ((by_angle, radians), (by_area, area), (by_angle, radians)):
        mesh.refine_triangles(most, criterion, threshold, outside, shortest)


def _without_repeats(ring: Ring) -> Ring:
    """Drop points equal to the one before, and a last point equal to the first."""
    keep = np.any(ring != np.roll(ring, 1, axis=0), axis=1)
    return ring[keep]


def _split_edges(ring: Ring, edge: float) -> Ring:
    """Insert points so that no side of the ring is longer than ``edge``."""
    pieces = []
    for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / edge - 1e-9)))
        pieces.append(start + (end - start) * np.arange(count)[:, None] / count)
    return np.concatenate(pieces) if pieces else ring


def _ring_edges(rings: Sequence[Ring]) -> Int[np.ndarray, "n 2"]:
    edges, start = [], 0
    for ring in rings:
        index = np.arange(len(ring))
        edges.append(np.stack([index, (index + 1) % len(ring)], axis=1) + start)
        start += len(ring)
    return np.concatenate(edges)


def _compact(
    vertices: Float[np.ndarray, "V 2"], triangles: Int[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "W 2"], Int[np.ndarray, "G 3"]]:
    """Drop triangles without area and vertices without a triangle; wind all triangles the same way."""
    areas = signed_areas(vertices, triangles)
    triangles = triangles[areas != 0.0]
    if not len(triangles):
        raise ValueError("triangulate: the rings enclose no area")
    flipped = signed_areas(vertices, triangles) < 0.0
    triangles[flipped] = triangles[flipped][:, [0, 2, 1]]
    used, index = np.unique(triangles, return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int64)
