"""Generator and critic of the appearance refinement.

The generator is pix2pix's U-Net: convolutions of stride 2 down, resized and joined with their mirror layers up. It
answers a correction of its input's base picture and starts at none, so that an untrained one changes nothing. There is
no normalisation: what is normal for a batch of a few patches is not for a picture. The critic scores patches, with no
BatchNorm, which the gradient penalty forbids (WGAN-GP); it sees the picture over white and its alpha.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

WIDEST = 8
"""Layers grow to this many times the first one's width, as in pix2pix."""
SLOPE = 0.2
COLOURS = 4
CRITIC_LAYERS = 4


class Generator(nn.Module):
    """``forward`` gives the correction; pictures of any size that ``2**depth`` divides."""

    def __init__(self, channels: int, width: int, depth: int, generator: torch.Generator) -> None:
        super().__init__()
        widths = [width * min(2**level, WIDEST) for level in range(depth + 1)]
        self.depth = depth
        self.first = nn.Conv2d(channels, width, 3, padding=1)
        self.down = nn.ModuleList(nn.Conv2d(widths[i], widths[i + 1], 4, 2, 1) for i in range(depth))
        self.up = nn.ModuleList(nn.Conv2d(widths[i + 1] + widths[i], widths[i], 3, padding=1) for i in range(depth))
        self.last = nn.Conv2d(width, COLOURS, 3, padding=1)
        start(self, generator)
        with torch.no_grad():
            self.last.weight.zero_()

    def forward(self, shown: Float[Tensor, "B C H W"]) -> Float[Tensor, "B 4 H W"]:
        """Find the correction of premultiplied RGBA."""
        levels = [functional.leaky_relu(self.first(shown), SLOPE)]
        for layer in self.down:
            levels.append(functional.leaky_relu(layer(levels[-1]), SLOPE))
        found = levels.pop()
        for layer, level in zip(reversed(self.up), reversed(levels), strict=True):
            larger = functional.interpolate(found, size=level.shape[-2:])
            found = functional.leaky_relu(layer(torch.cat([larger, level], 1)), SLOPE)
        correction: Tensor = self.last(found)
        return correction


class Critic(nn.Module):
    """Scores pictures, higher for drawn ones."""

    def __init__(self, width: int, generator: torch.Generator) -> None:
        super().__init__()
        widths = [COLOURS, *(width * min(2**level, WIDEST) for level in range(CRITIC_LAYERS))]
        self.layers = nn.ModuleList(nn.Conv2d(widths[i], widths[i + 1], 4, 2, 1) for i in range(CRITIC_LAYERS))
        self.last = nn.Conv2d(widths[-1], 1, 3, padding=1)
        start(self, generator)

    def forward(self, pictures: Float[Tensor, "B 4 H W"]) -> Float[Tensor, "B"]:
        """Score pictures, the mean over their patches."""
        found = pictures
        for layer in self.layers:
            found = functional.leaky_relu(layer(found), SLOPE)
        return torch.as_tensor(self.last(found).mean((1, 2, 3)))


def start(network: nn.Module, generator: torch.Generator) -> None:
    """Draw weights for leaky ReLUs (He et al. 2015); biases are 0."""
    with torch.no_grad():
        for name, values in network.named_parameters():
            if name.endswith("bias"):
                values.zero_()
            else:
                gain = 2.0 / (1.0 + SLOPE**2)
                values.normal_(0.0, (gain / values[0].numel()) ** 0.5, generator=generator)
