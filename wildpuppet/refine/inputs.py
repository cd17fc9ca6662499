"""What the generator is shown of a pose, and what it corrects.

"network", as the paper has it: the rendered puppet. "both": also the drawings' average, the nearest drawing's colours,
and how far they are known and agree (``texture.py``); the average is what is corrected then.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float32

from wildpuppet.refine.texture import Found, Look, Weights, look_of

Method = Literal["both", "network", "texture"]

CHANNELS = {"network": 4, "both": 14}
BASE = {"network": 0, "both": 4}
"""First of the four channels that the generator corrects and starts from."""
MOST_SPREAD = 2.0


def look_for(found: Found, weights: Weights, method: Method) -> tuple[Float32[np.ndarray, "H W C"], Look]:
    """Stack what the generator is shown, values 0..1; premultiplied pictures first."""
    look = look_of(found, weights)
    if method == "network":
        return found.drawn.rgba, look
    spread = np.minimum(look.spread / MOST_SPREAD, 1.0)
    stacked = np.dstack([found.drawn.rgba, look.blended, look.nearest, look.known, spread])
    return np.asarray(stacked, np.float32), look
