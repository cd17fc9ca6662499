"""A trained network as a decoder for handles: codes in, crop pixels of the run out."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.deform.model import Model


@dataclass(frozen=True, eq=False)
class Coded:
    """A model whose vertices are wanted in crops of ``size``, float64 in and out (the network itself has float32)."""

    model: Model
    size: tuple[int, int]

    def decode_tensor(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes; differentiable."""
        scale = torch.tensor([own / its for own, its in zip(self.size, self.model.size, strict=True)])
        return self.model.decode_tensor(codes.float()).double() * scale.double()
