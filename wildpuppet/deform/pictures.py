"""The distinct drawings that training reads, in any order, in flat memory."""

import tempfile
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int, UInt8
from torch import Tensor

from wildpuppet.deform.network import shrink
from wildpuppet.types import Crops

CHUNK = 32
"""Pictures read at a time."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """T frames small, for the encoder, in memory; D distinct drawings at full size, RGB, in a scratch file.

    ``first[d]`` is the frame that shows drawing d first.
    """

    first: Int[np.ndarray, "D"]
    full: UInt8[np.ndarray, "D H W 3"]
    small: UInt8[Tensor, "T 3 P P"]


def first_frames(crops: Crops) -> Int[np.ndarray, "T"]:
    """Find, for every frame, the first frame that shows the same drawing."""
    _, first, which = np.unique(crops.drawing, return_index=True, return_inverse=True)
    return np.asarray(first[which.reshape(-1)])


def read_small(crops: Crops, pixels: int) -> UInt8[Tensor, "T 3 P P"]:
    """Read all frames as the encoder sees them."""
    return torch.cat([_shrunk(_chunk(crops, start), pixels) for start in range(0, len(crops.frames), CHUNK)])


def read_pictures(crops: Crops, pixels: int) -> Pictures:
    """Read all frames once. The scratch file has no name and goes with the process."""
    first = np.unique(first_frames(crops))
    width, height = crops.size
    with tempfile.TemporaryFile() as scratch:  # the map outlives the handle
        full = np.memmap(scratch, np.uint8, "w+", shape=(len(first), height, width, 3))
    small = []
    for start in range(0, len(crops.frames), CHUNK):
        pictures = _chunk(crops, start)
        inside = np.flatnonzero((first >= start) & (first < start + CHUNK))
        full[inside] = pictures[first[inside] - start]
        small.append(_shrunk(pictures, pixels))
    return Pictures(first, full, torch.cat(small))


def _chunk(crops: Crops, start: int) -> UInt8[np.ndarray, "n H W 3"]:
    return np.ascontiguousarray(crops.images[start : start + CHUNK][..., :3])


def _shrunk(pictures: UInt8[np.ndarray, "n H W 3"], pixels: int) -> UInt8[Tensor, "n 3 P P"]:
    return (255.0 * shrink(torch.from_numpy(pictures), pixels) + 0.5).to(torch.uint8)
