"""Given points in the search: a part that does not bring its point to where it was given pays for the distance.

The pull is added to the part's template costs, so that the dynamic programme places the other parts around it, and to
the cost of whole poses. It is far stronger than any picture, and bounded, so that points that contradict one another
still leave a best pose.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.pose.templates import PartImage, Templates

# Cost per search pixel beyond what the grid's rounding explains, and its bound.
PULL, ROUNDING, MOST = 2.0, 0.8, 100.0


@dataclass(frozen=True, eq=False)
class Pull:
    """Point n, ``points_canvas[n]`` of layer ``layers[n]`` at rest, belongs at ``points_crop[n]``."""

    layers: Int[np.ndarray, " n"]
    points_canvas: Float[np.ndarray, "n 2"]
    points_crop: Float[np.ndarray, "n 2"]

    def add_to(
        self, unary: list[Float[np.ndarray, "K H W"]], images: tuple[PartImage, ...], templates: Templates,
        search_from_crop: float,
    ) -> None:  # fmt: skip
        """Add to the template costs: each part's at every angle and place of its pivot."""
        for n, layer in enumerate(self.layers.tolist()):
            rows, columns = (np.arange(size) + 0.5 for size in unary[layer].shape[1:])
            arm = self._arms(n, images, templates)
            x, y = search_from_crop * self.points_crop[n]
            far = np.hypot(columns + (arm[:, 0] - x)[:, None, None], (rows + (arm[:, 1] - y)[:, None])[..., None])
            unary[layer] += _cost(far).astype(np.float32)

    def on_states(
        self, states: Int[np.ndarray, "B L 3"], images: tuple[PartImage, ...], templates: Templates,
        search_from_crop: float,
    ) -> Float[np.ndarray, "B"]:  # fmt: skip
        """Cost whole poses."""
        total = np.zeros(len(states))
        for n, layer in enumerate(self.layers.tolist()):
            mine = states[:, layer]
            landed = mine[:, 1:] + 0.5 + self._arms(n, images, templates)[mine[:, 0]]
            total += _cost(np.linalg.norm(landed - search_from_crop * self.points_crop[n], axis=1))
        return total

    def _arms(self, n: int, images: tuple[PartImage, ...], templates: Templates) -> Float[np.ndarray, "K 2"]:
        """From the part's pivot to its point, for every angle."""
        x, y = (self.points_canvas[n] - images[self.layers[n]].pivot) * templates.scale
        cos, sin = np.cos(templates.radians), np.sin(templates.radians)
        return np.stack([cos * x - sin * y, sin * x + cos * y], -1)


def _cost(pixels: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    cost: Float[np.ndarray, "*shape"] = np.clip(PULL * (pixels - ROUNDING), 0.0, MOST)
    return cost
