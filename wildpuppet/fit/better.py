"""Of two fits of the same frames take, drawing by drawing, the better one."""

import dataclasses

import numpy as np
from jaxtyping import Bool

from wildpuppet.fit.solve import total
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Fit

TRUST = 1.05
"""The second fit is taken up to so many times the first one's energy.

It starts from what all frames together say, and a limb in the wrong place can have the lower pixel error (METHOD).
"""


def better(crops: Crops, first: Fit, second: Fit, settings: FitSettings) -> Fit:
    """Take the second fit wherever its energy is not much higher; a held drawing's frames stay together."""
    runs = np.cumsum(np.r_[False, (np.diff(crops.drawing) != 0) | (np.diff(crops.shot) != 0)])
    sums = [np.bincount(runs, total(fit.losses, settings)) for fit in (first, second)]
    is_second = (sums[1] <= TRUST * sums[0])[runs]
    return _mixed(first, second, is_second)


def _mixed(first: Fit, second: Fit, is_second: Bool[np.ndarray, "T"]) -> Fit:
    def pick(name: str) -> np.ndarray:
        a, b = getattr(first, name), getattr(second, name)
        return np.asarray(np.where(is_second.reshape(-1, *[1] * (a.ndim - 1)), b, a))

    arrays = {name: pick(name) for name in ("vertices_crop", "order", "confidence")}
    losses = {name: np.where(is_second, second.losses[name], first.losses[name]) for name in first.losses}
    states = tuple(b if chosen else a for a, b, chosen in zip(first.state, second.state, is_second, strict=True))
    return dataclasses.replace(first, **arrays, state=states, losses=losses)
