"""What a person may choose of an export, the same for every format; a format without a use for one ignores it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

Pictures = Callable[[int], UInt8[np.ndarray, "H W 3"]]
"""Gives a frame of the clip by its number."""


@dataclass(frozen=True)
class Options:
    """Choices of an export.

    ``first_frame`` numbers the first exported frame; None keeps the clip's own number. ``units_per_pixel`` is the
    length of one video pixel in formats of three dimensions; the programs that read them work best with scenes a few
    units wide. ``picture_frame`` is the clip frame that formats of one picture show; None: the puppet at rest.
    ``pictures`` are the clip's frames, for formats that carry them along (TAP-Vid).
    """

    first_frame: int | None = None
    units_per_pixel: float = 0.01
    picture_frame: int | None = None
    pictures: Pictures | None = None

    def first_of(self, clip_frame: int) -> int:
        """Number of the first exported frame, ``clip_frame`` in the clip."""
        return clip_frame if self.first_frame is None else self.first_frame
