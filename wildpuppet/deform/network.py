"""The deformation network of Neural Puppet (section 3.2): a picture goes in, vertices come out.

Picture -> three convolutions (kernel 5, stride 2, padding 2; 64, 128, 256) -> fully connected 1024, 1024, 512 = the
code z -> 1024 -> 2048 -> an offset per vertex and one global bias, added to the puppet's placed rest pose. ReLU between
layers. Details the paper leaves open are those of the reconstruction network published with Neural Mesh Renderer,
with which it agrees in every stated one: the encoder sees a small picture (64 x 64), and the bias learns at a tenth of
the rate. Both heads start at zero: an untrained network answers the rest pose.

Coordinates are unit coordinates: [-1, 1] along the crop's larger side, as ``wildpuppet.fit.energy.to_unit`` maps them.
"""

from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn
from torch.nn import functional

from wildpuppet.settings import TrainSettings

CHANNELS = (64, 128, 256)
ENCODER = (1024, 1024)
DECODER = (1024, 2048)


@runtime_checkable
@runtime_checkable
class Network(Protocol):
    """What both recipes' networks (torch modules) can do; unit coordinates."""

    pixels: int

    def encode(self, pictures: Float[Tensor, "B 3 P P"]) -> Float[Tensor, "B Z"]:
        """Find the codes of pictures (RGB 0..1, made by ``shrink``)."""

    def decode(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes."""


class DeformationNetwork(nn.Module):
    """``decode(encode(pictures))`` gives vertices around ``base``, the rest pose in unit coordinates."""

    base: Tensor

    def __init__(
        self, base: Float[Tensor, "V 2"], code: int, code_relu: bool, pixels: int, generator: torch.Generator
    ) -> None:
        super().__init__()
        self.code_relu, self.pixels = code_relu, pixels
        sizes = (3, *CHANNELS)
        self.convolutions = nn.ModuleList(
            nn.Conv2d(sizes[i], sizes[i + 1], kernel_size=5, stride=2, padding=2) for i in range(len(CHANNELS))
        )
        side = pixels
        for _ in CHANNELS:
            side = (side + 1) // 2
        self.to_code = _linears((CHANNELS[-1] * side * side, *ENCODER, code))
        self.from_code = _linears((code, *DECODER))
        self.to_offsets = nn.Linear(DECODER[-1], base.numel())
        self.to_bias = nn.Linear(DECODER[-1], 2)
        self.register_buffer("base", base.clone())
        self._start(generator)

    def encode(self, pictures: Float[Tensor, "B 3 P P"]) -> Float[Tensor, "B Z"]:
        """Find the codes of pictures (RGB 0..1, made by ``shrink``)."""
        found = pictures
        for convolution in self.convolutions:
            found = functional.relu(convolution(found))
        found = found.flatten(1)
        for index, layer in enumerate(self.to_code):
            is_code = index == len(self.to_code) - 1
            found = layer(found) if is_code and not self.code_relu else functional.relu(layer(found))
        return found

    def decode(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes, unit coordinates."""
        found = codes
        for layer in self.from_code:
            found = functional.relu(layer(found))
        offsets = self.to_offsets(found).reshape(-1, *self.base.shape)
        placed: Tensor = self.base + offsets + self.to_bias(found)[:, None, :]
        return placed

    def forward(self, pictures: Float[Tensor, "B 3 P P"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices that pictures show, unit coordinates."""
        return self.decode(self.encode(pictures))

    def _start(self, generator: torch.Generator) -> None:
        """Draw weights with variance 1 / inputs, as Neural Mesh Renderer's framework does; biases and heads are 0."""
        with torch.no_grad():
            for name, values in self.named_parameters():
                if name.startswith(("to_offsets", "to_bias")) or name.endswith("bias"):
                    values.zero_()
                else:
                    values.normal_(0.0, values[0].numel() ** -0.5, generator=generator)


def empty_network(base: Float[Tensor, "V 2"], train: TrainSettings) -> DeformationNetwork:
    """Build a network at its start around ``base``, unit coordinates."""
    generator = torch.Generator().manual_seed(train.seed)
    return DeformationNetwork(base, train.code, train.code_relu, train.encoder_pixels, generator)


def shrink(pictures: UInt8[Tensor, "B H W 3"], pixels: int) -> Float[Tensor, "B 3 P P"]:
    """Fit RGB pictures into a square for the encoder, 0..1: the aspect stays, the rest is black."""
    height, width = pictures.shape[1:3]
    scale = pixels / max(height, width)
    new = (max(1, round(height * scale)), max(1, round(width * scale)))
    image = pictures.permute(0, 3, 1, 2).float() / 255.0
    small = functional.interpolate(image, size=new, mode="bilinear", antialias=True)
    top, left = (pixels - new[0]) // 2, (pixels - new[1]) // 2
    return functional.pad(small, (left, pixels - new[1] - left, top, pixels - new[0] - top))


def _linears(sizes: tuple[int, ...]) -> nn.ModuleList:
    return nn.ModuleList(nn.Linear(sizes[i], sizes[i + 1]) for i in range(len(sizes) - 1))
