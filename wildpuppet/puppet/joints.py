"""Hinges: where they stand on the canvas, and the mesh points that hold them."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from wildpuppet.types import CutOut, JointSpec, Part


def joint_positions(cutout: CutOut, least_alpha: int) -> Float[np.ndarray, "J 2"]:
    """Place every joint on the canvas: where it is given, else at its parts' overlap or nearest points."""
    parts = {part.name: part for part in cutout.parts}
    places = [_place(joint, parts, least_alpha) for joint in cutout.joints]
    return np.array(places, np.float64).reshape(-1, 2)


def overlap_centroid(a: Bool[np.ndarray, "H W"], b: Bool[np.ndarray, "H W"]) -> tuple[float, float] | None:
    """Find the centroid (corner origin) of the area that two parts share, None where there is none."""
    rows, columns = np.nonzero(a & b)
    return (float(columns.mean()) + 0.5, float(rows.mean()) + 0.5) if len(rows) else None


def nearest_middle(a: Bool[np.ndarray, "H W"], b: Bool[np.ndarray, "H W"]) -> tuple[tuple[float, float], float]:
    """Find the point halfway between two areas where they come closest, and the distance between them there."""
    points_a, points_b = np.argwhere(a)[:, ::-1] + 0.5, np.argwhere(b)[:, ::-1] + 0.5
    distance, index = cKDTree(points_a).query(points_b)
    nearest = int(distance.argmin())
    middle = 0.5 * (points_a[index[nearest]] + points_b[nearest])
    return (float(middle[0]), float(middle[1])), float(distance[nearest])


def barycentrics(point: Float[np.ndarray, "2"], corners: Float[np.ndarray, "F 3 2"]) -> Float[np.ndarray, "F 3"]:
    """Write a point as a mix of the corners of each triangle; outside a triangle a weight is negative."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    total = _cross(b - a, c - a)
    v = _cross(point - a, c - a) / total
    w = _cross(b - a, point - a) / total
    return np.stack([1.0 - v - w, v, w], axis=1)


def attach(
    point: Float[np.ndarray, "2"], vertices: Float[np.ndarray, "V 2"], triangles: Int[np.ndarray, "F 3"]
) -> tuple[Int[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Tie a point to a mesh: the triangle that holds it, else the nearest one, extrapolated.

    Returns the triangle's vertices and their weights, which sum to 1 and give the point exactly.
    """
    corners = vertices[triangles]
    weights = barycentrics(point, corners)
    inside = weights.min(axis=1)
    best = int(inside.argmax())
    if inside[best] < -1e-9:
        best = int(_distances(point, corners).argmin())
    return triangles[best], weights[best]


def _place(joint: JointSpec, parts: dict[str, Part], least_alpha: int) -> tuple[float, float]:
    if joint.at is not None:
        return joint.at
    a, b = (parts[name].rgba[..., 3] >= least_alpha for name in joint.parts)
    return overlap_centroid(a, b) or nearest_middle(a, b)[0]


def _cross(a: Float[np.ndarray, "F 2"], b: Float[np.ndarray, "F 2"]) -> Float[np.ndarray, "F"]:
    cross: Float[np.ndarray, " F"] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return cross


def _distances(point: Float[np.ndarray, "2"], corners: Float[np.ndarray, "F 3 2"]) -> Float[np.ndarray, "F"]:
    """Measure how far a point is from each triangle's sides."""
    start, end = corners, np.roll(corners, -1, axis=1)
    along = end - start
    length = np.maximum((along**2).sum(axis=2), np.finfo(float).tiny)
    share = np.clip(((point - start) * along).sum(axis=2) / length, 0.0, 1.0)
    distances: Float[np.ndarray, " F"] = np.linalg.norm(start + share[..., None] * along - point, axis=2).min(axis=1)
    return distances
