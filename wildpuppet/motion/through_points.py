"""Poses that pass through known points: what a benchmark's truth says about a whole mesh.

Every part is moved by the similarity that its own points ask for (parts with fewer than three stay as in the base
pose, moved with the points of all), then the mesh is bent smoothly, so that it passes through the points: least
squares on the points and the mesh Laplacian of the bend.
"""

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import spsolve

from wildpuppet.correspond.locate import Anchors
from wildpuppet.geometry.topology import vertex_adjacency
from wildpuppet.types import Puppet

POINT_WEIGHT = 100.0
"""Weight of a point against the bend's smoothness; higher passes through noisy points more closely."""
LEAST_POINTS = 3
"""Points that a part needs to have a similarity of its own."""


def posed_by_points(
    puppet: Puppet, base: Float[np.ndarray, "V 2"], anchors: Anchors, points: Float[np.ndarray, "T N 2"]
) -> Float[np.ndarray, "T V 2"]:
    """Pose the puppet through ``points``; those that are not finite do not count.

    ``base`` is the pose in which ``anchors`` were located.
    """
    adjacency = vertex_adjacency(puppet.triangles, len(base))
    degrees = np.asarray(adjacency.sum(1)).ravel()
    laplacian = sparse.csr_array(sparse.diags_array(degrees) - adjacency)
    smooth = sparse.csr_array(laplacian.T @ laplacian) + 1e-3 * sparse.eye_array(len(base))
    return np.stack([_posed(puppet, base, anchors, row, smooth) for row in points])


def _posed(
    puppet: Puppet,
    base: Float[np.ndarray, "V 2"],
    anchors: Anchors,
    points: Float[np.ndarray, "N 2"],
    smooth: sparse.csr_array,
) -> Float[np.ndarray, "V 2"]:
    counts = np.isfinite(points).all(1) & np.isfinite(anchors.weights).all(1)
    corners, weights, wanted = anchors.corners[counts], anchors.weights[counts], points[counts]
    if len(wanted) < LEAST_POINTS:
        return base.copy()
    before = (base[corners] * weights[..., None]).sum(1)
    start = _moved(base, before, wanted)
    for layer in range(puppet.num_layers):
        on_it, of_it = anchors.layer[counts] == layer, puppet.layer_of_vertex == layer
        if on_it.sum() >= LEAST_POINTS:
            start[of_it] = _moved(base[of_it], before[on_it], wanted[on_it])
    rows = np.repeat(np.arange(len(wanted)), 3)
    mix = sparse.csr_array((weights.reshape(-1), (rows, corners.reshape(-1))), shape=(len(wanted), len(base)))
    normal = sparse.csc_array(POINT_WEIGHT * (mix.T @ mix) + smooth)
    return np.asarray(start + spsolve(normal, POINT_WEIGHT * (mix.T @ (wanted - mix @ start))))


def _moved(
    points: Float[np.ndarray, "n 2"], before: Float[np.ndarray, "m 2"], after: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "n 2"]:
    """Move points by the similarity that lays ``before`` on ``after`` best."""
    middle, centre = before.mean(0), after.mean(0)
    a, b = before - middle, after - centre
    cos, sin = float((a * b).sum()), float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    linear = np.array([[cos, -sin], [sin, cos]]) / max(float((a**2).sum()), 1e-9)
    return np.asarray((points - middle) @ linear.T + centre)
