"""What the signs are worth: weights of a logistic function, fitted on puppets' own renders with known truth.

``python -m tests.calibrate_confidence`` fitted them; no labelled clip or drawing was seen.
"""

import numpy as np
from jaxtyping import Float

from wildpuppet.fit.signs import NAMES

BIAS = -2.935
WEIGHTS = {
    "worth": 1.47,
    "worth_of_part": 2.18,
    "agreement": 0.09,
    "agreement_of_part": 0.56,
    "agreement_of_all": 3.46,
    "explained": 5.17,
    "explained_by_part": 6.23,
    "seen": 0.92,
    "seen_of_part": 1.30,
    "margin": 2.29,
    "closed": 0.0,
    "near": 0.0,
    "steady": 11.38,
}


def probability(signs: Float[np.ndarray, "*n K"]) -> Float[np.ndarray, "*n"]:
    """Turn signs into the probability that a vertex lies within a twentieth of the character's size of its place."""
    odds = BIAS + signs @ np.array([WEIGHTS[name] for name in NAMES])
    return np.asarray(1 / (1 + np.exp(-odds)))
