"""What the renderer needs to know of a puppet besides its texture: triangles and the layer of each."""

from typing import NamedTuple

import torch
from jaxtyping import Int
from torch import Tensor

from wildpuppet.types import Puppet


class Mesh(NamedTuple):
    """Triangles over the vertices of all layers.

    Triangles may have either orientation (a mirrored puppet is drawn). Where triangles of one layer overlap (a fold),
    the first in this list is drawn, so that a layer covers each pixel at most once.
    """

    triangles: Int[Tensor, "F 3"]
    layer_of_triangle: Int[Tensor, "F"]
    num_layers: int

    def to(self, device: torch.device) -> "Mesh":
        """Move to a device."""
        return Mesh(self.triangles.to(device), self.layer_of_triangle.to(device), self.num_layers)


def mesh_of(puppet: Puppet) -> Mesh:
    """Take the mesh out of a puppet."""
    return Mesh(
        torch.tensor(puppet.triangles, dtype=torch.int64),
        torch.tensor(puppet.layer_of_triangle, dtype=torch.int64),
        puppet.num_layers,
    )
