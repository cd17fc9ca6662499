"""What the signs are worth: weights of a logistic function, fitted on puppets' own renders with known truth.

``python -m tests.calibrate_confidence`` fitted them; no labelled clip or drawing was seen.
"""

import numpy as np
from jaxtyping import Float

from wildpuppet.fit.signs import NAMES

BIAS = -2.716
WEIGHTS = {
    "worth": 1.44,
    "worth_of_part": 2.55,
    "agreement_of_part": 0.78,
    "agreement_of_all": 2.52,
    "explained": 6.62,
    "explained_by_part": 6.48,
    "seen": 1.01,
    "seen_of_part": 1.30,
    "margin": 1.93,
    "steady": 8.12,
}


def probability(signs: Float[np.ndarray, "*n K"]) -> Float[np.ndarray, "*n"]:
    """Turn signs into the probability that a vertex lies within a twentieth of the character's size of its place."""
    odds = BIAS + signs @ np.array([WEIGHTS[name] for name in NAMES])
    return np.asarray(1 / (1 + np.exp(-odds)))
