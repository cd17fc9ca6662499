"""The medial axis of a silhouette as a rooted tree: where limbs are, how thick and how long.

Every node is a pixel of the axis with the radius of the largest disc around it that fits inside (Blum 1967). Holes make
rings in the axis; each ring is opened where the silhouette is thinnest.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from skimage.morphology import medial_axis

CENTRALITY = 0.3
"""The root is the node of largest radius, less this share of its distance from the silhouette's centroid."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Nodes in an order in which parents come before children; node 0 is the root, its own parent.

    ``points`` are (x, y), corner origin. ``depth`` is the path length from the root, ``reach`` the longest path from a
    node away from the root to where the silhouette ends.
    """

    points: Float[np.ndarray, "N 2"]
    radius: Float[np.ndarray, " N"]
    parent: Int[np.ndarray, " N"]
    depth: Float[np.ndarray, " N"]
    reach: Float[np.ndarray, " N"]

    def toward_tip(self) -> Int[np.ndarray, " N"]:
        """Find each node's child on the longest path, itself at a leaf."""
        child = np.arange(len(self.parent))
        best = np.full(len(self.parent), -np.inf)
        for node in range(1, len(self.parent)):
            parent, length = self.parent[node], self.depth[node] + self.reach[node]
            if length > best[parent]:
                best[parent], child[parent] = length, node
        return child


def skeleton_of(mask: Bool[np.ndarray, "H W"], seed: int) -> Skeleton:
    """Build the tree of a silhouette in one piece; a piece apart from the root's is left out."""
    axis, distance = medial_axis(np.pad(mask, 1), return_distance=True, rng=seed)  # type: ignore[no-untyped-call]
    axis, distance = axis[1:-1, 1:-1], distance[1:-1, 1:-1]
    rows, columns = np.nonzero(axis)
    points = np.stack([columns + 0.5, rows + 0.5], axis=1)
    radius = distance[rows, columns]
    middle = np.argwhere(mask).mean(axis=0)[::-1] + 0.5
    root = int((radius - CENTRALITY * np.linalg.norm(points - middle, axis=1)).argmax())
    tree = _open_rings(_neighbours(axis, rows, columns), radius)
    order, parent = breadth_first_order(tree, root, directed=False)
    place = np.full(len(points), -1)
    place[order] = np.arange(len(order))
    parents = np.concatenate([[0], place[parent[order[1:]]]]).astype(np.int64)
    return _measured(points[order], radius[order], parents)


def _neighbours(
    axis: Bool[np.ndarray, "H W"], rows: Int[np.ndarray, " N"], columns: Int[np.ndarray, " N"]
) -> Int[np.ndarray, "E 2"]:
    """List the pairs of axis pixels that touch, corners included."""
    number = np.full((axis.shape[0] + 1, axis.shape[1] + 2), -1)
    number[rows, columns + 1] = np.arange(len(rows))
    pairs = []
    for down, across in ((0, 1), (1, -1), (1, 0), (1, 1)):
        other = number[rows + down, columns + 1 + across]
        pairs.append(np.stack([np.flatnonzero(other >= 0), other[other >= 0]], axis=1))
    return np.concatenate(pairs)


def _open_rings(pairs: Int[np.ndarray, "E 2"], radius: Float[np.ndarray, " N"]) -> csr_matrix:
    """Keep the tree of the thickest paths."""
    thick = np.minimum(radius[pairs[:, 0]], radius[pairs[:, 1]])
    weights = radius.max() + 1.0 - thick
    graph = csr_matrix((weights, (pairs[:, 0], pairs[:, 1])), shape=(len(radius), len(radius)))
    return minimum_spanning_tree(graph)


def _measured(
    points: Float[np.ndarray, "N 2"], radius: Float[np.ndarray, " N"], parent: Int[np.ndarray, " N"]
) -> Skeleton:
    steps = np.linalg.norm(points - points[parent], axis=1)
    depth = np.zeros(len(points))
    for node in range(1, len(points)):
        depth[node] = depth[parent[node]] + steps[node]
    reach = radius.copy()
    for node in range(len(points) - 1, 0, -1):
        reach[parent[node]] = max(reach[parent[node]], reach[node] + steps[node])
    return Skeleton(points, radius, parent, depth, reach)
