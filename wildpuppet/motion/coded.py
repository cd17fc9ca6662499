"""A trained network as a decoder for handles: codes in, crop pixels of the run out."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.deform.model import Model
from wildpuppet.motion.drag import Known


@dataclass(frozen=True, eq=False)
class Coded:
    """A model whose vertices are wanted in crops of ``size``, float64 in and out (the network itself has float32)."""

    model: Model
    size: tuple[int, int]

    def decode_tensor(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes; differentiable."""
        scale = torch.tensor([own / its for own, its in zip(self.size, self.model.size, strict=True)])
        return self.model.decode_tensor(codes.float()).double() * scale.double()


def coded_space(model: Model, size: tuple[int, int], poses: Float[np.ndarray, "K V 2"]) -> tuple[Coded, Known]:
    """Give a model as a decoder and the codes of poses (crop pixels of a run's crops of ``size``).

    For the networks whose codes can be told from vertices alone.
    """
    scale = np.array(model.size, np.float64) / np.array(size, np.float64)
    codes = model.codes_of(poses * scale)
    return Coded(model, size), Known(poses, codes, np.zeros((0, codes.shape[1])))
