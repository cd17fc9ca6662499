"""What the descent compares the puppet with, at one pyramid level.

Colours are Lab, stretched so that lightness spans 0..255 like the paper's images; the matte turns into a price for
covering background and for leaving the character uncovered.
"""

from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from wildpuppet.pose.evidence import LAB_UNIT, lab_texture
from wildpuppet.puppet.colour import lab
from wildpuppet.render.texture import Texture, texture_at
from wildpuppet.types import Puppet

WHITE = 255.0


class Target(NamedTuple):
    """A batch of frames at one level.

    ``colour`` Lab, lightness 0..255. ``cover_gain`` is what covering a pixel is worth, in squared grey levels:
    ``worth`` on the character, minus that on the background, half of it where the matte does not know (a puppet that
    gained nothing there would shrink).
    """

    colour: Float[Tensor, "B H W 3"]
    cover_gain: Float[Tensor, "B H W"]
    level: float


def target_at(images: UInt8[np.ndarray, "B H W 4"], level: float, worth: float) -> Target:
    """Shrink crops to ``level`` (level pixels per crop pixel); ``worth`` is the gain of a sure character pixel."""
    height, width = images.shape[1:3]
    size = (max(4, round(width * level)), max(4, round(height * level)))
    colours, gains = [], []
    for image in images:
        small = image if level == 1 else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        unit = small.astype(np.float32) / 255
        colours.append(lab(unit[..., :3]) * (WHITE / LAB_UNIT))
        gains.append(np.where(unit[..., 3] < 0.5, 3 * unit[..., 3] - 1, unit[..., 3]) * worth)
    return Target(
        torch.from_numpy(np.stack(colours).astype(np.float32)),
        torch.from_numpy(np.stack(gains).astype(np.float32)),
        level,
    )


def texture_for(puppet: Puppet, level_from_canvas: float) -> Texture:
    """Prepare the puppet's texture in the target's colours (premultiplied, lightness 0..1 for 0..255)."""
    return lab_texture(texture_at(puppet, level_from_canvas))
