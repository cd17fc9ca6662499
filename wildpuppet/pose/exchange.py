"""Twins that wear each other's colours: telling a left limb from a right one where its shape misleads.

A leg that is drawn in one frame as the other leg was in the reference fits the *other* leg's picture, all but the
colour: the far leg is a shade darker. So a pose is also judged with the colours of two twins exchanged. Where that
explains the frame better, it is the right pose with the limbs' names traded.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from wildpuppet.pose.evidence import LAB_UNIT
from wildpuppet.pose.twins import Pair
from wildpuppet.render.texture import Texture
from wildpuppet.types import Puppet

PRICE = 0.1
"""Cost of an exchange, in units of an average part's evidence: a limb seldom looks like its twin's drawing."""
LEAST_SHADE = 4.0
"""Distance in Lab between the mean colours of twins from which on they can be told apart."""


def told_apart(pairs: Sequence[Pair], colours: Float[np.ndarray, "L 3"]) -> list[Pair]:
    """Keep the pairs of which some parts differ in shade; ``colours`` are the parts' mean colours in Lab."""
    return [
        pair for pair in pairs
        if max(np.linalg.norm(colours[a] - colours[b]) for a, b in zip(*pair, strict=True)) >= LEAST_SHADE
    ]  # fmt: skip


def exchange_colours(
    texture: Texture, puppet: Puppet, pairs: Sequence[Pair], colours: Float[np.ndarray, "L 3"]
) -> Texture:
    """Move each twin's colours by the difference between the twins' means; ``texture`` is a ``lab_texture``."""
    rgba = texture.rgba.numpy().copy()
    uv = texture.uv.numpy()
    for pair in pairs:
        for layer, other in [*zip(*pair, strict=True), *zip(*pair[::-1], strict=True)]:
            mine = uv[puppet.layer_of_vertex == layer]
            low, high = np.floor(mine.min(0)).astype(int).clip(0), np.ceil(mine.max(0)).astype(int)
            patch = rgba[low[1] : high[1], low[0] : high[0]]
            patch[..., :3] += patch[..., 3:] * ((colours[other] - colours[layer]) / LAB_UNIT).astype(np.float32)
    return texture._replace(rgba=torch.from_numpy(rgba))
