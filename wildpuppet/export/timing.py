"""When frames are shown: exact times, and the frame rate that they stand for if they stand for one.

Times are ``pts * time_base``. A container may round them (Matroska: to milliseconds), so frames count as evenly
spaced when every time is within one tick of an even grid. Anything else is a variable rate: formats that count
frames then say so in their manifest, and those that have times keep them exactly.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Int

COMMON_RATES = tuple(
    Fraction(rate)
    for rate in (24, Fraction(24000, 1001), 25, 30, Fraction(30000, 1001), 12, 15, 50, 60, Fraction(60000, 1001))
)
DRAWINGS_RATE = Fraction(4)
"""Drawings per second: a folder of drawings has no times of its own, and a person wants to look at each."""
ALONE_RATE = Fraction(24)
"""The rate of a single frame."""


@dataclass(frozen=True, eq=False)
class Timing:
    """Exact times of the frames. ``rate`` (frames per second) is the nominal one where times are uneven."""

    pts: Int[np.ndarray, "T"]
    time_base: Fraction
    rate: Fraction
    is_variable: bool

    def seconds(self, index: int) -> Fraction:
        """Time of a frame from the first one; on the even grid unless the rate is variable."""
        return self.clip_seconds(index) if self.is_variable else index / self.rate

    def clip_seconds(self, index: int) -> Fraction:
        """Time of a frame from the first one as the clip's container has it."""
        return int(self.pts[index] - self.pts[0]) * self.time_base

    def end_seconds(self) -> Fraction:
        """When the last frame ends: it lasts one nominal frame."""
        return self.seconds(len(self.pts) - 1) + 1 / self.rate


def timing_of(num_frames: int, times: tuple[Int[np.ndarray, "T"], Fraction] | None) -> Timing:
    """Find the rate of the frames' times; None stands for drawings."""
    if times is None:
        return Timing(np.arange(num_frames, dtype=np.int64), 1 / DRAWINGS_RATE, DRAWINGS_RATE, False)
    pts, base = np.asarray(times[0], np.int64), times[1]
    if len(pts) < 2:
        return Timing(pts, base, ALONE_RATE, False)
    gaps = np.diff(pts)
    if (gaps == gaps[0]).all() and Fraction(1) / (int(gaps[0]) * base) in COMMON_RATES:
        return Timing(pts, base, Fraction(1) / (int(gaps[0]) * base), False)
    mean = Fraction(len(gaps)) / (int(pts[-1] - pts[0]) * base)
    even = [rate for rate in (*COMMON_RATES, mean) if _fits(pts, base, rate)]
    if even:
        return Timing(pts, base, even[0], False)
    typical = Fraction(1) / (int(np.median(gaps)) * base)
    tick = float(base)
    near = [rate for rate in COMMON_RATES if abs(float(1 / rate) - float(1 / typical)) <= tick]
    return Timing(pts, base, near[0] if near else typical, True)


def _fits(pts: Int[np.ndarray, "T"], base: Fraction, rate: Fraction) -> bool:
    """Tell whether every time is within a tick of an even grid at this rate, and the gaps at least look alike."""
    ticks = (pts - pts[0]).astype(np.float64)
    grid = np.arange(len(pts)) * float(1 / (rate * base))
    if len(pts) < 3 and abs(ticks[-1] - grid[-1]) > 0:
        return False
    return bool(np.abs(ticks - grid).max() <= 1.0)
