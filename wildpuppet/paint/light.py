"""The light of each frame on the character, against the puppet's texture: dusk, a fade, a darker shot.

Measured between the frame and the unpainted puppet where that is opaque, as ``crop/light.py`` measures backgrounds,
and bridged over frames that say little.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.crop.light import LEAST_CHANGE, light_between
from wildpuppet.paint.layers import Drawn

SURE = 0.98
LEAST_SHOT = 0.08
"""A steady shot has the texture's own light when it differs by less (log)."""

Light = tuple[float, float, float]


def light_of(picture: UInt8[np.ndarray, "H W 3"], drawn: Drawn | None) -> Float[np.ndarray, "3"]:
    """Measure one frame's light; not a number where there is no character."""
    if drawn is None:
        return np.full(3, np.nan)
    texture = np.rint(drawn.before[..., :3] * 255.0).astype(np.uint8)
    return light_between(picture[drawn.window], texture, drawn.before[..., 3] > SURE)


def lights(measured: Sequence[Float[np.ndarray, "3"]], shot: Int[np.ndarray, "T"]) -> list[Light]:
    """Decide each frame's light: its own in shots whose light changes, one for the whole shot elsewhere."""
    gains = np.log(np.array(measured))
    decided = np.zeros_like(gains)
    for number in np.unique(shot):
        mine = np.flatnonzero(shot == number)
        known = mine[np.isfinite(gains[mine]).all(1)]
        if not len(known):
            continue
        middle = np.median(gains[known], axis=0)
        spread = np.percentile(gains[known], 95, axis=0) - np.percentile(gains[known], 5, axis=0)
        if spread.max() >= LEAST_CHANGE:
            decided[mine] = np.stack([np.interp(mine, known, gains[known, channel]) for channel in range(3)], 1)
        elif np.abs(middle).max() >= LEAST_SHOT:
            decided[mine] = middle
    return [(float(red), float(green), float(blue)) for red, green, blue in np.exp(decided)]
