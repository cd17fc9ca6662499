"""How near two poses are, part by part.

A part's look depends on how it and what is near it are posed, so that the drawing that shows an arm as it is now need
not be the one that shows a leg so. The distance of two poses at part l is the root mean square move of the vertices,
each weighted by how near it lies to part l at rest, after the weighted mean move is taken away.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from wildpuppet.types import Puppet

FALL = 0.25
"""Rest distance, as a share of the character's size, at which a vertex counts 1/e; higher compares whole poses."""


class Nearness:
    """Compares poses of one puppet; distances are shares of the character's size in ``vertices``."""

    def __init__(self, puppet: Puppet, vertices: Float[np.ndarray, "N V 2"]) -> None:
        rest = puppet.vertices.astype(np.float64)
        size = max(_spread(rest[None])[0], np.finfo(float).tiny)
        rows = []
        for layer in range(puppet.num_layers):
            mine = rest[puppet.layer_of_vertex == layer]
            away = cKDTree(mine).query(rest)[0] if len(mine) else np.zeros(len(rest))
            weight = np.exp(-away / (FALL * size))
            rows.append(weight / weight.sum())
        self._weights = np.stack(rows)
        self._vertices = vertices
        self._size = max(float(np.median(_spread(vertices))), np.finfo(float).tiny)

    def distances(self, pose: Float[np.ndarray, "V 2"]) -> Float[np.ndarray, "N L"]:
        """Compare a pose with all of ``vertices``, at every part."""
        moves = self._vertices - pose
        square = (moves**2).sum(-1) @ self._weights.T
        mean = np.einsum("lv,nvd->nld", self._weights, moves)
        return np.asarray(np.sqrt(np.maximum(square - (mean**2).sum(-1), 0.0)) / self._size)


def _spread(poses: Float[np.ndarray, "N V 2"]) -> Float[np.ndarray, "N"]:
    """Root mean square distance of the vertices from their mean."""
    return np.asarray(np.sqrt(((poses - poses.mean(1, keepdims=True)) ** 2).sum(-1).mean(1)))
