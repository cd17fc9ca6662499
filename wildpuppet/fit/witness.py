"""What the signs need of a puppet, prepared once: its size, its textures, and what lies around each vertex."""

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from wildpuppet.geometry.arap import ArapRest, arap_rest, best_scale_of
from wildpuppet.pose import evidence as ev
from wildpuppet.pose.place import rest_box
from wildpuppet.pose.tree import part_areas
from wildpuppet.render.render import Mesh, mesh_of
from wildpuppet.render.surface import Surface, surface
from wildpuppet.render.texture import Texture, texture_at
from wildpuppet.types import Puppet

PIXELS = 96.0
"""Pixels along the larger side of the puppet at rest, at which frames are looked at."""
AROUND = 0.04
"""Standard deviation of what counts as around a vertex on its part, as a share of the character's size."""
SIZE_STEP = 1.06
"""Ratio between the sizes at which textures are kept."""


@dataclass(eq=False)
class Witness:
    """What is prepared once per puppet; textures are kept per size."""

    puppet: Puppet
    size: float = field(init=False)
    mesh: Mesh = field(init=False)
    rest: ArapRest = field(init=False)
    areas: Float[np.ndarray, "L"] = field(init=False)
    around: csr_array = field(init=False)
    pixels_at_rest: Float[np.ndarray, "V"] = field(init=False)
    textures: dict[int, Texture] = field(default_factory=dict)

    def __post_init__(self) -> None:
        puppet = self.puppet
        self.size = float(rest_box(puppet)[2:].max())
        self.mesh = mesh_of(puppet)
        self.rest = arap_rest(puppet.vertices.astype(np.float32), puppet.triangles)
        self.areas = part_areas(puppet)
        self.around = _around(puppet, AROUND * self.size)
        self.pixels_at_rest = self._pixels_at_rest()

    def texture(self, scale: float) -> Texture:
        """Fetch or make the Lab texture of a size."""
        step = round(math.log(scale) / math.log(SIZE_STEP))
        if step not in self.textures:
            if len(self.textures) > 4:
                self.textures.pop(next(iter(self.textures)))
            self.textures[step] = ev.lab_texture(texture_at(self.puppet, SIZE_STEP**step))
        return self.textures[step]

    def per_layer(self, of_vertices: Float[np.ndarray, "V"]) -> Float[np.ndarray, "L"]:
        """Sum over the vertices of each layer."""
        return np.bincount(self.puppet.layer_of_vertex, of_vertices, self.puppet.num_layers)

    def spread(self, values: Float[np.ndarray, "n"], pixels: "SeenPixels") -> Float[np.ndarray, "V"]:
        """Give each seen pixel's value to the corners of its triangle, by its barycentrics."""
        total = np.zeros(len(self.puppet.vertices))
        for corner in range(3):
            vertices = self.puppet.triangles[pixels.triangle, corner]
            total += np.bincount(vertices, values * pixels.weights[:, corner], len(total))
        return total

    def _pixels_at_rest(self) -> Float[np.ndarray, "V"]:
        """Count the pixels around each vertex when its layer stands alone."""
        puppet, scale = self.puppet, PIXELS / self.size
        low = puppet.vertices.min(0)
        placed = torch.from_numpy(((puppet.vertices - low) * scale + 1).astype(np.float32))[None]
        width, height = (np.ceil(np.ptp(puppet.vertices, axis=0) * scale).astype(int) + 3).tolist()
        total = np.zeros(len(puppet.vertices))
        for layer in range(puppet.num_layers):
            alone = torch.zeros(1, puppet.num_layers)
            alone[0, layer] = 1.0
            order = torch.arange(puppet.num_layers)[None]
            shown = surface(placed, self.mesh, self.texture(scale), order, (width, height), alone)
            pixels = seen_pixels(shown)
            total += self.spread((pixels.layer == layer).astype(np.float64), pixels)
        return total


@dataclass(frozen=True, eq=False)
class SeenPixels:
    """The pixels on which the puppet is seen: layer, triangle and barycentrics."""

    rows: Int[np.ndarray, "n"]
    columns: Int[np.ndarray, "n"]
    layer: Int[np.ndarray, "n"]
    triangle: Int[np.ndarray, "n"]
    weights: Float[np.ndarray, "n 3"]


def seen_pixels(shown: Surface) -> SeenPixels:
    """List where the first frame of a surface shows the puppet."""
    layer = shown.layer[0].numpy()
    rows, columns = np.nonzero(layer >= 0)
    triangle, weights = shown.triangle[0].numpy(), shown.barycentrics[0].numpy()
    return SeenPixels(rows, columns, layer[rows, columns], triangle[rows, columns], weights[rows, columns])


def _around(puppet: Puppet, reach: float) -> csr_array:
    """Weigh the vertices of a part by their distance at rest: a Gaussian, nothing between parts."""
    pairs = cKDTree(puppet.vertices).sparse_distance_matrix(cKDTree(puppet.vertices), 3 * reach, output_type="ndarray")
    same = puppet.layer_of_vertex[pairs["i"]] == puppet.layer_of_vertex[pairs["j"]]
    pairs = pairs[same]
    number = len(puppet.vertices)
    weights = np.exp(-0.5 * (pairs["v"] / reach) ** 2)
    return csr_array((weights, (pairs["i"], pairs["j"])), shape=(number, number))


def size_in(witness: Witness, vertices: Float[np.ndarray, "V 2"]) -> float:
    """Size of the character in a crop, pixels: the puppet's at rest, at the scale that it has there."""
    return witness.size * float(best_scale_of(vertices[None].astype(np.float32), witness.rest)[0])
