"""The deforming auto-encoder baseline (Shu et al. 2018), small: a drawing = a texture seen through a warp.

The encoder reads a 64 x 64 picture and writes two codes. One becomes a texture, the other a warp: for every pixel the
place in the texture whose colour it has. The warp is a map of its own offsets, positive and bounded and added up along
x and y, so that it keeps the order of pixels and cannot fold, followed by one affine map. No puppet, no parts: what
two drawings have in common is found by the texture they share.

Pictures are RGB 0..1; places are [-1, 1] over the square, as torch's grid_sample takes them (its edges, not its pixel
centres, are -1 and 1).
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

SIDE = 64
CHANNELS = (8, 16, 32, 48)
HIDDEN = 96
TEXTURE_CODE, WARP_CODE = 16, 64
PAPER = 2.0
"""Textures start nearly white (before the sigmoid): drawings stand on white paper."""
STEEPEST = 4.0
"""An offset lies between 0 and this many times the identity's."""


class Seen(NamedTuple):
    """What the network makes of pictures: the pictures again, their textures and warps, and the warps' offsets."""

    pictures: Float[Tensor, "B 3 S S"]
    textures: Float[Tensor, "B 3 S S"]
    warps: Float[Tensor, "B 2 S S"]
    offsets: Float[Tensor, "B 2 S S"]


class DeformingAutoEncoder(nn.Module):
    """Texture code and warp code; an untrained network's warp is the identity."""

    def __init__(self, generator: torch.Generator) -> None:
        super().__init__()
        sizes = (3, *CHANNELS)
        self.convolutions = nn.ModuleList(
            nn.Conv2d(sizes[i], sizes[i + 1], kernel_size=4, stride=2, padding=1) for i in range(len(CHANNELS))
        )
        self.corner = SIDE // 2 ** len(CHANNELS)
        self.to_codes = nn.Linear(CHANNELS[-1] * self.corner**2, TEXTURE_CODE + WARP_CODE)
        self.texture = _Decoder(TEXTURE_CODE, 3, self.corner)
        self.warp = _Decoder(WARP_CODE, 2, self.corner)
        self.to_affine = nn.Linear(WARP_CODE, 6)
        self._start(generator)

    def forward(self, pictures: Float[Tensor, "B 3 S S"], own_texture: float = 1.0) -> Seen:
        """Take pictures apart and put them together again.

        At ``own_texture`` 0 all share one texture, so that only the warp can tell them apart.
        """
        found = pictures
        for convolution in self.convolutions:
            found = functional.leaky_relu(convolution(found), 0.2)
        codes = self.to_codes(found.flatten(1))
        texture_code, warp_code = codes.split((TEXTURE_CODE, WARP_CODE), 1)
        textures = torch.sigmoid(self.texture(texture_code * own_texture))
        offsets = _offsets(self.warp(warp_code))
        warps = _moved(_added_up(offsets), self.to_affine(warp_code))
        seen = functional.grid_sample(
            textures, warps.permute(0, 2, 3, 1), mode="bilinear", padding_mode="border", align_corners=False
        )
        return Seen(seen, textures, warps, offsets)

    def _start(self, generator: torch.Generator) -> None:
        """Draw weights with He's variance; biases, and what leads to warps, start at 0."""
        with torch.no_grad():
            for name, values in self.named_parameters():
                if name == "texture.last.bias":
                    values.fill_(PAPER)
                elif name.endswith("bias") or name.startswith(("to_affine", "warp.last")):
                    values.zero_()
                else:
                    values.normal_(0.0, (2.0 / values[0].numel()) ** 0.5, generator=generator)


class _Decoder(nn.Module):
    """A code becomes a map, doubling its side from layer to layer."""

    def __init__(self, code: int, channels: int, corner: int) -> None:
        super().__init__()
        self.corner = corner
        sizes = CHANNELS[::-1]
        self.first = nn.Linear(code, HIDDEN)
        self.second = nn.Linear(HIDDEN, sizes[0] * corner**2)
        self.layers = nn.ModuleList(nn.Conv2d(sizes[i], sizes[i + 1], 3, padding=1) for i in range(len(sizes) - 1))
        self.last = nn.Conv2d(sizes[-1], channels, 3, padding=1)

    def forward(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B C S S"]:
        found = functional.leaky_relu(self.first(codes), 0.2)
        found = functional.leaky_relu(self.second(found), 0.2).reshape(len(codes), -1, self.corner, self.corner)
        for layer in self.layers:
            found = functional.leaky_relu(layer(functional.interpolate(found, scale_factor=2.0)), 0.2)
        decoded: Tensor = self.last(functional.interpolate(found, scale_factor=2.0))
        return decoded


def _offsets(free: Float[Tensor, "B 2 S S"]) -> Float[Tensor, "B 2 S S"]:
    """Bound offsets to (0, STEEPEST) pixels; 0 becomes one pixel."""
    start = torch.log(torch.tensor(1.0 / (STEEPEST - 1.0), dtype=free.dtype))
    return STEEPEST * torch.sigmoid(free + start)


def _added_up(offsets: Float[Tensor, "B 2 S S"]) -> Float[Tensor, "B 2 S S"]:
    """Add x offsets along rows and y offsets along columns: the place of each pixel's centre."""
    x, y = offsets[:, 0], offsets[:, 1]
    places = torch.stack([x.cumsum(2) - x / 2.0, y.cumsum(1) - y / 2.0], 1)
    return places * (2.0 / SIDE) - 1.0


def _moved(places: Float[Tensor, "B 2 S S"], affine: Float[Tensor, "B 6"]) -> Float[Tensor, "B 2 S S"]:
    """Apply one affine map per picture, given as what is added to the identity."""
    matrices = affine.reshape(-1, 2, 3)
    return places + torch.einsum("bij,bjhw->bihw", matrices[:, :, :2], places) + matrices[:, :, 2:, None]
