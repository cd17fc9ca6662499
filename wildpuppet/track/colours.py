"""The character's colours: how much likelier each is on the character than around it.

Lab colours are counted in a coarse table. Knowing the background at the reference frame sharpens the counts: a pixel of
the box that shows background does not count as the character.
"""

from functools import cache

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.ndimage import gaussian_filter

from wildpuppet.track.trackers import Box

# Steps of lightness and of the two colour axes, the latter over the middle half of their range.
LIGHTNESS_BINS, COLOUR_BINS = 8, 12
NUM_BINS = LIGHTNESS_BINS * COLOUR_BINS * COLOUR_BINS
# The colours around are counted this far beyond the box, as a share of its sides.
RING = 0.5
# Weight of the colours' log-odds beside the background's.
COLOUR_WEIGHT = 0.7
# A colour is absent when less than this share of the character has it; its log-odds fall by so much.
ABSENT_SHARE, ABSENT_ODDS = 4e-4, 3.0
# A colour that is this much rarer inside than around tells nothing.
LEAST_RATIO = 0.05


class Colours:
    """``weight`` (bins,): probability of the character where both places are equally large; ``odds``: the log-odds."""

    def __init__(self, inside: Float[np.ndarray, " bins"], around: Float[np.ndarray, " bins"]) -> None:
        first, second = normalised(inside), normalised(around)
        self.weight = np.clip((first + 1e-5) / (first + second + 1e-4), LEAST_RATIO, 1.0)
        self.inside = normalised(inside * self.weight)
        self.distinctive = float((first * self.weight).sum())
        probable = self.weight.clip(0.05, 0.95)
        cube = first.reshape(LIGHTNESS_BINS, COLOUR_BINS, COLOUR_BINS)
        nearby = gaussian_filter(cube, 0.7, mode="nearest").ravel()
        absent = np.clip(1.0 - nearby / ABSENT_SHARE, 0.0, 1.0)
        self.odds = (COLOUR_WEIGHT * np.log(probable / (1.0 - probable)) - ABSENT_ODDS * absent).astype(np.float32)

    def probability(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
        """Map how distinctive of the character each pixel's colour is, 0 to 1."""
        mapped: np.ndarray = self.weight.astype(np.float32)[colour_bins(image)]
        return mapped

    def log_odds(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
        """Map the log-odds that a pixel of this colour is the character's."""
        odds: np.ndarray = self.odds[colour_bins(image)]
        return odds

    def similarity(self, found: Float[np.ndarray, " bins"]) -> float:
        """Compare counted colours with the character's distinctive ones, 0 to 1."""
        kept = float((found * self.weight).sum() / max(found.sum(), 1.0))
        overlap = float(np.sqrt(normalised(found * self.weight) * self.inside).sum())
        return overlap * min(1.0, kept / max(self.distinctive, 1e-6))


def colours_of_box(image: UInt8[np.ndarray, "h w 3"], box: Box) -> Colours:
    """Learn from a box alone: the ellipse that touches it against the ring around it."""
    return Colours(ellipse_counts(image, box), ring_counts(image, box))


def ellipse_counts(image: UInt8[np.ndarray, "h w 3"], box: Box) -> Float[np.ndarray, " bins"]:
    """Count colours inside the ellipse that touches the box; all 0 where the box lies outside the image."""
    left, top, right, bottom = pixel_bounds(image, box)
    if right <= left or bottom <= top:
        return np.zeros(NUM_BINS)
    x = (np.arange(left, right) + 0.5 - box[0] - box[2] / 2) / (box[2] / 2)
    y = (np.arange(top, bottom) + 0.5 - box[1] - box[3] / 2) / (box[3] / 2)
    ellipse = x[None, :] ** 2 + y[:, None] ** 2 < 1.0
    return counted(image[top:bottom, left:right], ellipse)


def ring_counts(image: UInt8[np.ndarray, "h w 3"], box: Box) -> Float[np.ndarray, " bins"]:
    """Count colours around the box."""
    x, y, w, h = box
    outer = (x - RING * w, y - RING * h, w * (1 + 2 * RING), h * (1 + 2 * RING))
    left, top, right, bottom = pixel_bounds(image, outer)
    weight = np.ones((max(bottom - top, 0), max(right - left, 0)))
    inner = pixel_bounds(image, box)
    weight[max(inner[1] - top, 0) : max(inner[3] - top, 0), max(inner[0] - left, 0) : max(inner[2] - left, 0)] = 0
    return counted(image[top:bottom, left:right], weight) if weight.size else np.zeros(NUM_BINS)


def counted(region: UInt8[np.ndarray, "h w 3"], weight: np.ndarray) -> Float[np.ndarray, " bins"]:
    """Count a picture's colours, each pixel by its weight."""
    if region.size == 0:
        return np.zeros(NUM_BINS)
    return np.bincount(colour_bins(region).ravel(), weights=weight.ravel().astype(np.float64), minlength=NUM_BINS)


def colour_bins(image: UInt8[np.ndarray, "h w 3"]) -> Int[np.ndarray, "h w"]:
    """Number each pixel's colour; BGR."""
    steps = cv2.LUT(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2LAB), bin_table())
    lightness, first, second = (steps[..., channel].astype(np.int16) for channel in range(3))
    number: np.ndarray = (lightness * COLOUR_BINS + first) * COLOUR_BINS + second
    return number


@cache
def bin_table() -> UInt8[np.ndarray, "1 256 3"]:
    """Tabulate the step of every lightness and colour value."""
    value = np.arange(256)
    lightness = value * LIGHTNESS_BINS // 256
    colour = ((value - 64) * COLOUR_BINS // 128).clip(0, COLOUR_BINS - 1)
    return np.stack([lightness, colour, colour], 1)[None].astype(np.uint8)


def normalised(counts: Float[np.ndarray, " bins"]) -> Float[np.ndarray, " bins"]:
    """Divide by the sum."""
    return counts / max(float(counts.sum()), 1e-6)


def pixel_bounds(image: UInt8[np.ndarray, "h w 3"], box: Box) -> tuple[int, int, int, int]:
    """Round a box to left, top, right, bottom inside the image; right <= left where nothing is left of it."""
    height, width = image.shape[:2]
    left, top = max(round(box[0]), 0), max(round(box[1]), 0)
    return left, top, min(round(box[0] + box[2]), width), min(round(box[1] + box[3]), height)
