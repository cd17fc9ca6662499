"""Triangle meshes as index arrays: borders, neighbours, connected components and midpoint subdivision."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components


def unique_edges(triangles: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "E 2"]:
    """List every edge once, lower vertex first, in ascending order."""
    edges: Int[np.ndarray, "E 2"] = np.unique(np.sort(_directed_edges(triangles), axis=1), axis=0)
    return edges


def boundary_edges(triangles: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "B 2"]:
    """List the edges that belong to one triangle only, in that triangle's direction."""
    directed = _directed_edges(triangles)
    _, index, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    border: Int[np.ndarray, "B 2"] = directed[count[index.reshape(-1)] == 1]
    return border


def vertex_adjacency(triangles: Int[np.ndarray, "F 3"], num_vertices: int) -> csr_matrix:
    """Build the symmetric (V, V) matrix that is 1 where an edge joins two vertices."""
    edges = unique_edges(triangles)
    rows = np.concatenate([edges[:, 0], edges[:, 1]])
    columns = np.concatenate([edges[:, 1], edges[:, 0]])
    return csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(num_vertices, num_vertices))


def components(triangles: Int[np.ndarray, "F 3"], num_vertices: int) -> tuple[int, Int[np.ndarray, "V"]]:
    """Count connected components and number each vertex by its own; a vertex of no triangle is one by itself."""
    count, labels = connected_components(vertex_adjacency(triangles, num_vertices), directed=False)
    return int(count), labels.astype(np.int64)


def subdivide(
    vertices: Float[np.ndarray, "V 2"], triangles: Int[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "W 2"], Int[np.ndarray, "G 3"], Int[np.ndarray, "E 2"]]:
    """Split each triangle into four at its edges' midpoints.

    Returns the vertices (the old ones first, unmoved), the triangles (the children of triangle f are 4f to 4f + 3,
    wound as it is) and, for each new vertex, the two old ones it lies between.
    """
    directed = np.sort(_directed_edges(triangles), axis=1)
    edges, index = np.unique(directed, axis=0, return_inverse=True)
    middle = (index.reshape(-1) + len(vertices)).reshape(3, -1).T
    a, b, c = triangles.T
    ab, bc, ca = middle.T
    children = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    finer = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    return finer, children.transpose(2, 0, 1).reshape(-1, 3), edges


def signed_areas(
    vertices: Float[np.ndarray, "*batch V 2"], triangles: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "*batch F"]:
    """Measure triangles' areas; positive where the corners turn from x towards y (clockwise on screen)."""
    a, b, c = (vertices[..., triangles[:, corner], :] for corner in range(3))
    areas: Float[np.ndarray, "*batch F"] = 0.5 * (
        (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    )
    return areas


def smallest_angles(vertices: Float[np.ndarray, "V 2"], triangles: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, "F"]:
    """Measure each triangle's smallest angle in degrees; 0 where a triangle has no area."""
    corners = vertices[triangles]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    a, b, c = np.sort(sides, axis=1).T
    cosine = (b * b + c * c - a * a) / np.maximum(2.0 * b * c, np.finfo(float).tiny)
    angles: Float[np.ndarray, " F"] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return np.where(c > 0.0, angles, 0.0)


def _directed_edges(triangles: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "E 2"]:
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
