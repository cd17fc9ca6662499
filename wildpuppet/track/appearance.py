"""Does this box show the character? A score of our own, because a tracker's own flag is unreliable.

Two views are averaged: how much of the character's distinctive colours the box holds (histogram overlap, each colour
weighted by how much more frequent it is inside the reference box than in the ring around it), and how well the box
matches the reference picture or a slowly running one (normalised correlation of small pictures). 1 is the reference
itself, background scores about 0 to 0.25, an articulated character mostly above 0.5.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.track.trackers import Box

HISTOGRAM_BINS = (8, 12, 12)
LAB_RANGES = [0, 256, 64, 192, 64, 192]
PATCH = 24
RUNNING_RATE = 0.08
# A colour that is this much rarer inside than around tells nothing.
LEAST_RATIO = 0.05


class Appearance:
    """The character's look, learnt from the reference frame; ``update`` lets it age slowly."""

    def __init__(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        self.aspect = box[2] / box[3]
        inside, around = histogram(image, box), ring_histogram(image, box)
        self.weight = colour_weights(inside, around)
        self.colours = normalised(inside * self.weight)
        self.reference = patch(image, box)
        self.running = self.reference.copy()

    def score(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> float:
        """Judge a box, 0 to 1."""
        found = histogram(image, box)
        kept = float((found * self.weight).sum() / max(found.sum(), 1.0))
        expected = float(self.weight_of_reference)
        overlap = float(np.sqrt(normalised(found * self.weight) * self.colours).sum())
        colour = overlap * min(1.0, kept / max(expected, 1e-6))
        seen = patch(image, box)
        match = max(correlation(seen, self.reference), correlation(seen, self.running), 0.0)
        return 0.5 * (colour + match)

    @property
    def weight_of_reference(self) -> float:
        """Share of the reference box's pixels that count as distinctive, softly."""
        total = self.colours / np.maximum(self.weight, LEAST_RATIO)
        return float(self.colours.sum() / max(total.sum(), 1e-6))

    def update(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        """Let the running picture follow a box that is surely the character."""
        self.running = (1 - RUNNING_RATE) * self.running + RUNNING_RATE * patch(image, box)

    def probability(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
        """Map how distinctive of the character each pixel's colour is, 0 to 1."""
        lab = cv2.cvtColor(image, cv2.COLOR_BGR2LAB)
        scaled = (self.weight * 255).astype(np.float32)
        mapped: np.ndarray = cv2.calcBackProject([lab], [0, 1, 2], scaled, LAB_RANGES, 1.0)
        return mapped.astype(np.float32) / 255.0


def colour_weights(
    inside: Float[np.ndarray, "a b c"], around: Float[np.ndarray, "a b c"]
) -> Float[np.ndarray, "a b c"]:
    """Return for each colour the probability of "inside" when both places are equally large, damped for rare colours."""
    first, second = normalised(inside), normalised(around)
    weights: np.ndarray = (first + 1e-5) / (first + second + 1e-4)
    return np.clip(weights, LEAST_RATIO, 1.0)


def histogram(image: UInt8[np.ndarray, "h w 3"], box: Box) -> Float[np.ndarray, "a b c"]:
    """Count colours inside the ellipse that touches the box; empty where the box lies outside the image."""
    left, top, right, bottom = pixel_bounds(image, box)
    if right <= left or bottom <= top:
        return np.zeros(HISTOGRAM_BINS, np.float32)
    x = (np.arange(left, right) + 0.5 - box[0] - box[2] / 2) / (box[2] / 2)
    y = (np.arange(top, bottom) + 0.5 - box[1] - box[3] / 2) / (box[3] / 2)
    ellipse = (x[None, :] ** 2 + y[:, None] ** 2 < 1.0).astype(np.uint8)
    return counted(image[top:bottom, left:right], ellipse)


def ring_histogram(image: UInt8[np.ndarray, "h w 3"], box: Box, reach: float = 0.5) -> Float[np.ndarray, "a b c"]:
    """Count colours around the box, out to ``reach`` of its sides."""
    x, y, w, h = box
    left, top, right, bottom = pixel_bounds(
        image, (x - reach * w, y - reach * h, w * (1 + 2 * reach), h * (1 + 2 * reach))
    )
    mask = np.ones((max(bottom - top, 0), max(right - left, 0)), np.uint8)
    if mask.size == 0:
        return np.zeros(HISTOGRAM_BINS, np.float32)
    inner = pixel_bounds(image, box)
    mask[max(inner[1] - top, 0) : max(inner[3] - top, 0), max(inner[0] - left, 0) : max(inner[2] - left, 0)] = 0
    return counted(image[top:bottom, left:right], mask)


def counted(region: UInt8[np.ndarray, "h w 3"], mask: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "a b c"]:
    """Histogram the Lab colours under a mask, a little blurred over the bins."""
    lab = cv2.cvtColor(np.ascontiguousarray(region), cv2.COLOR_BGR2LAB)
    counts: np.ndarray = cv2.calcHist([lab], [0, 1, 2], mask, list(HISTOGRAM_BINS), LAB_RANGES)
    return counts.astype(np.float32)


def patch(image: UInt8[np.ndarray, "h w 3"], box: Box) -> Float[np.ndarray, "p p 3"]:
    """Cut the box out and shrink it to a small square picture."""
    left, top, right, bottom = pixel_bounds(image, box)
    if right <= left or bottom <= top:
        return np.zeros((PATCH, PATCH, 3), np.float32)
    small: np.ndarray = cv2.resize(image[top:bottom, left:right], (PATCH, PATCH), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32)


def correlation(first: Float[np.ndarray, "p p 3"], second: Float[np.ndarray, "p p 3"]) -> float:
    """Correlate two pictures, -1 to 1; 0 where one is flat."""
    a, b = first - first.mean((0, 1)), second - second.mean((0, 1))
    norm = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / norm if norm > 1.0 else 0.0


def normalised(counts: Float[np.ndarray, "a b c"]) -> Float[np.ndarray, "a b c"]:
    """Divide by the sum."""
    return counts / max(float(counts.sum()), 1e-6)


def pixel_bounds(image: UInt8[np.ndarray, "h w 3"], box: Box) -> tuple[int, int, int, int]:
    """Round a box to left, top, right, bottom inside the image; right <= left where nothing is left of it."""
    height, width = image.shape[:2]
    left, top = max(round(box[0]), 0), max(round(box[1]), 0)
    return left, top, min(round(box[0] + box[2]), width), min(round(box[1] + box[3]), height)
