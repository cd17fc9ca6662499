"""Which frames of a fit a person should look at first. Numpy only: a run that is kept asks for this."""

import numpy as np

from wildpuppet.types import Fit

MOST = 6
"""Frames that are named."""
APART = 4
"""Frames between two that are named: neighbours mostly go wrong together."""


def worth_a_look(fit: Fit, most: int = MOST) -> list[int]:
    """Choose up to ``most`` frame numbers, those without the character first, then the least trusted.

    Held frames are left out, since they show the drawing of an earlier one.
    """
    is_lost = np.array([state == "lost" for state in fit.state])
    trust = np.where(is_lost, -1.0, fit.confidence.mean(1))
    chosen: list[int] = []
    for index in np.argsort(trust, kind="stable").tolist():
        is_apart = all(abs(index - other) >= APART for other in chosen)
        if len(chosen) < most and fit.state[index] != "held" and is_apart:
            chosen.append(index)
    return [int(fit.frames[index]) for index in chosen]
