"""A soft matte for each crop; in this first version everything is unknown."""

import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.machine import Machine
from wildpuppet.types import Clip, Track


class Matter:
    """Says of each crop pixel how surely it is the character."""

    def matte(
        self, t: int, crop: UInt8[np.ndarray, "H W 3"], video_from_crop: Float[np.ndarray, "2 3"]
    ) -> UInt8[np.ndarray, "H W"]:
        """Return 255 surely the character, 0 surely not, 128 unknown."""
        return np.full(crop.shape[:2], 128, np.uint8)


def prepare_matter(clip: Clip, track: Track, reference: int, machine: Machine) -> Matter:
    """Look at the clip once and learn what the mattes need."""
    return Matter()
