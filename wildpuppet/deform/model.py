"""A trained deformation network, ready to use: ``decode(encode(pictures))`` with numpy at its boundary.

``wildpuppet.models`` writes and reads the MODEL folder. Codes are what inbetweening mixes, what handles move and what
a picture is read into; vertices are crop pixels of a frame of ``size``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from wildpuppet.deform.invert import nearest_code
from wildpuppet.deform.learn import one_thread
from wildpuppet.deform.network import Network, shrink
from wildpuppet.deform.reader import PuppetNetwork
from wildpuppet.fit.energy import from_unit, to_unit
from wildpuppet.settings import TrainSettings
from wildpuppet.types import Puppet

Recipe = Literal["ours", "paper"]

CHUNK = 64
"""Pictures read at a time."""
WHITE = 255.0
LEAST_TRUST = 0.05
"""A vertex that is trusted less counts so much."""


@dataclass(frozen=True, eq=False)
class Model:
    """A network in eval mode on the CPU, the built puppet that it moves, and the crop frame of its vertices.

    ``size`` is (W, H) of that frame, crop pixels. ``is_on_paper``: it was trained on drawings, whose matte is known
    and which it sees over white; pictures of clips it sees as they are. ``hold_out`` lists the frames that it was to
    be kept from. ``losses[name]`` is one number per step.
    """

    puppet: Puppet
    size: tuple[int, int]
    network: Network
    train: TrainSettings
    recipe: Recipe = "paper"
    is_on_paper: bool = False
    hold_out: tuple[int, ...] = ()
    losses: Mapping[str, Float[np.ndarray, "S"]] = field(default_factory=dict)

    def encode(self, images: UInt8[np.ndarray, "B H W channels"]) -> Float[np.ndarray, "B Z"]:
        """Read pictures, crops as they were cut for training (of any resolution, of the ratio W : H).

        With four channels the last is the matte; it is used where the model was trained on drawings.
        """
        codes = []
        with one_thread(), torch.no_grad():
            for start in range(0, len(images), CHUNK):
                pictures = self.seen(images[start : start + CHUNK])
                codes.append(self.network.encode(shrink(torch.from_numpy(pictures), self.network.pixels)))
        return torch.cat(codes).numpy().astype(np.float64)

    def decode(self, codes: Float[np.ndarray, "B Z"]) -> Float[np.ndarray, "B V 2"]:
        """Find the vertices of codes, crop pixels."""
        with one_thread(), torch.no_grad():
            vertices = self.decode_tensor(torch.from_numpy(np.array(codes)).float())
        return vertices.numpy().astype(np.float64)

    def decode_tensor(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes, crop pixels; differentiable in the codes."""
        return from_unit(self.network.decode(codes), self.size)

    def codes_of(
        self,
        vertices: Float[np.ndarray, "B V 2"],
        trust: Float[np.ndarray, "B V"] | None = None,
        start: Float[np.ndarray, "B Z"] | None = None,
    ) -> Float[np.ndarray, "B Z"]:
        """Find the codes whose vertices come nearest to given ones (those of a fit, crop pixels).

        ``trust`` weighs the vertices. Ours solves for the code at once; the paper's network takes some steps from the
        codes ``start``, such as those of the pictures.
        """
        trust = np.ones(vertices.shape[:2]) if trust is None else np.maximum(trust, LEAST_TRUST)
        with one_thread():
            placed = to_unit(torch.from_numpy(np.array(vertices)), self.size)
            if isinstance(self.network, PuppetNetwork):
                return self.network.codes_of(placed.numpy(), trust)
            first = np.zeros((len(vertices), self.train.code)) if start is None else start
            weights, codes = torch.from_numpy(trust).float(), torch.from_numpy(np.array(first)).float()
            found = [nearest_code(self.network, *one) for one in zip(placed.float(), weights, codes, strict=True)]
        return torch.stack(found).numpy().astype(np.float64)

    def seen(self, images: UInt8[np.ndarray, "B H W channels"]) -> UInt8[np.ndarray, "B H W 3"]:
        """Give pictures as the encoder is shown them: three channels, drawings over white."""
        if images.shape[-1] == 4 and self.is_on_paper:
            return over_white(images)
        return np.ascontiguousarray(images[..., :3])


def over_white(images: UInt8[np.ndarray, "B H W 4"]) -> UInt8[np.ndarray, "B H W 3"]:
    """Lay straight-alpha pictures over white paper."""
    alpha = images[..., 3:].astype(np.float32) / WHITE
    return np.asarray(images[..., :3] * alpha + WHITE * (1.0 - alpha) + 0.5, np.uint8)
