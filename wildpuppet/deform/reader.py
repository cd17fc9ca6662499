"""Our network: a reader that finds points of the puppet in a picture, and a skeleton that moves between poses.

Decoding is linear up to the skeleton: pose = mean + z W, with the directions W in order of how far they move the
puppet and z of unit variance over the poses that it was taught: a two-sided code, in which straight lines turn parts
about their hinges. Encoding finds some points of every part (heat maps, soft-argmax; Nibali et al. 2018) and takes
them and coarse features to the code.
"""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from wildpuppet.deform.skeleton import Code, Skeleton, SkeletonTensors, poses_of, skeleton_from, vertices_of

CHANNELS = (24, 48, 96, 128)
COARSE = 16
HIDDEN = 256


class PuppetNetwork(nn.Module):
    """``decode(encode(pictures))`` gives vertices, unit coordinates."""

    skeleton: SkeletonTensors
    mean: Tensor
    directions: Tensor
    coordinates: Tensor
    points: Tensor

    def __init__(
        self,
        skeleton: Skeleton,
        code: Code,
        points: Int[np.ndarray, "K"],
        pixels: int,
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        self.pixels = pixels
        self.skeleton = SkeletonTensors(skeleton)
        for name in ("mean", "directions", "coordinates"):
            self.register_buffer(name, torch.from_numpy(np.array(getattr(code, name))).float())
        self.register_buffer("points", torch.from_numpy(np.array(points)).long())
        first, second, third, fourth = CHANNELS
        self.down = nn.ModuleList(
            [
                nn.Conv2d(3, first, 5, 2, 2),
                nn.Conv2d(first, second, 3, 2, 1),
                nn.Conv2d(second, third, 3, 2, 1),
                nn.Conv2d(third, fourth, 3, 2, 1),
                nn.Conv2d(fourth, fourth, 3, 1, 1),
            ]
        )
        self.mix = nn.ModuleList([nn.Conv2d(fourth + third, 64, 1), nn.Conv2d(64 + second, 48, 1)])
        self.refine = nn.ModuleList([nn.Conv2d(64, 64, 3, 1, 1), nn.Conv2d(48, 48, 3, 1, 1)])
        self.heat = nn.Conv2d(48, len(points), 1)
        self.coarse = nn.Conv2d(fourth, COARSE, 1)
        side = pixels
        for _ in CHANNELS:
            side = (side + 1) // 2
        self.hidden = nn.Linear(4 * len(points) + COARSE * side * side, HIDDEN)
        self.hidden2 = nn.Linear(HIDDEN, HIDDEN)
        self.code = nn.Linear(HIDDEN, len(code.directions))
        self.direct = nn.Linear(2 * len(points), len(code.directions))
        self._start(generator)

    def read(self, pictures: Float[Tensor, "B 3 P P"]) -> tuple[Float[Tensor, "B K 2"], Float[Tensor, "B Z"]]:
        """Find the points (unit coordinates) and the codes."""
        found, levels = pictures - 0.5, []
        for convolution in self.down:
            found = functional.relu(convolution(found))
            levels.append(found)
        coarse = functional.relu(self.coarse(found)).flatten(1)
        for mix, refine, level in zip(self.mix, self.refine, (levels[2], levels[1]), strict=True):
            up = functional.interpolate(found, size=level.shape[2:], mode="bilinear", align_corners=False)
            found = functional.relu(mix(torch.cat([up, level], 1)))
            found = functional.relu(found + refine(found))
        places, spread = soft_argmax(self.heat(found))
        flat = places.flatten(1)
        hidden = functional.relu(self.hidden(torch.cat([flat, spread.flatten(1), coarse], 1)))
        hidden = functional.relu(hidden + self.hidden2(hidden))
        return places, self.direct(flat) + self.code(hidden)

    def encode(self, pictures: Float[Tensor, "B 3 P P"]) -> Float[Tensor, "B Z"]:
        """Find the codes of pictures (RGB 0..1, made by ``shrink``)."""
        return self.read(pictures)[1]

    def decode(self, codes: Float[Tensor, "B Z"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices of codes, unit coordinates."""
        return vertices_of(self.skeleton, self.mean + codes @ self.directions)

    def codes_of(
        self, vertices: Float[np.ndarray, "B V 2"], trust: Float[np.ndarray, "B V"]
    ) -> Float[np.ndarray, "B Z"]:
        """Find the codes of vertices, unit coordinates; exact up to bends that the skeleton does not know."""
        mean = self.mean.numpy().astype(np.float64)
        poses = poses_of(skeleton_from(dict(self.skeleton.named_buffers())), vertices, trust, mean)
        return np.asarray((poses - mean) @ self.coordinates.numpy().astype(np.float64))

    def forward(self, pictures: Float[Tensor, "B 3 P P"]) -> Float[Tensor, "B V 2"]:
        """Find the vertices that pictures show, unit coordinates."""
        return self.decode(self.encode(pictures))

    def _start(self, generator: torch.Generator) -> None:
        with torch.no_grad():
            for name, values in self.named_parameters():
                if name.endswith("bias") or name.startswith(("code", "direct")):
                    values.zero_()
                else:
                    values.normal_(0.0, (2.0 / values[0].numel()) ** 0.5, generator=generator)
            self.heat.weight.mul_(0.3)


def reader_from(tensors: Mapping[str, Tensor], pixels: int) -> PuppetNetwork:
    """Build the network that a state_dict belongs to."""
    part = {name.removeprefix("skeleton."): tensor for name, tensor in tensors.items() if name.startswith("skeleton.")}
    code = Code(*(tensors[name].numpy() for name in ("mean", "directions", "coordinates")))
    network = PuppetNetwork(
        skeleton_from(part), code, tensors["points"].numpy(), pixels, torch.Generator().manual_seed(0)
    )
    network.load_state_dict(dict(tensors))
    return network


def soft_argmax(heat: Float[Tensor, "B K h w"]) -> tuple[Float[Tensor, "B K 2"], Float[Tensor, "B K 2"]]:
    """Give each map's mean place and standard deviations, unit coordinates of the square picture."""
    height, width = heat.shape[2:]
    share = heat.flatten(2).softmax(-1).reshape(heat.shape)
    x = (torch.arange(width, device=heat.device) + 0.5) * (2.0 / width) - 1.0
    y = (torch.arange(height, device=heat.device) + 0.5) * (2.0 / height) - 1.0
    columns, rows = share.sum(2), share.sum(3)
    mean = torch.stack([columns @ x, rows @ y], -1)
    square = torch.stack([columns @ x**2, rows @ y**2], -1)
    return mean, (square - mean**2).clamp_min(1e-6).sqrt()


def points_of(skeleton: Skeleton) -> Int[np.ndarray, "K"]:
    """Choose vertices to look for: those farthest apart, two of every part, three of larger ones."""
    chosen: list[int] = []
    for layer in range(skeleton.num_layers):
        mine = np.flatnonzero(skeleton.layer_of_vertex == layer)
        own = skeleton.rest[mine]
        found = [int(np.linalg.norm(own - own.mean(0), axis=1).argmax())]
        for _ in range(2 if np.ptp(own, axis=0).max() > LARGE else 1):
            distance = np.linalg.norm(own[:, None] - own[found], axis=-1).min(1)
            found.append(int(distance.argmax()))
        chosen += mine[found].tolist()
    return np.array(chosen)


LARGE = 0.25
"""From this share of the puppet's size on, a part is looked for by three points."""
