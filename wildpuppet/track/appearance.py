"""Does this box show the character? A score of our own, because a tracker's own flag is unreliable.

Two views are averaged: how much of the character's distinctive colours the box holds, and how well the box matches the
reference picture or a slowly running one (normalised correlation of small pictures). 1 is the reference itself,
background scores about 0 to 0.25, an articulated character mostly above 0.5.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.track.colours import Colours, ellipse_counts, pixel_bounds
from wildpuppet.track.trackers import Box

PATCH = 24
RUNNING_RATE = 0.08
SURE_COLOURS = 0.5


class Appearance:
    """The character's look, learnt from the reference frame; ``update`` lets it age slowly."""

    def __init__(self, image: UInt8[np.ndarray, "h w 3"], box: Box, colours: Colours) -> None:
        self.colours = colours
        self.reference = patch(image, box)
        self.running = self.reference.copy()

    def score(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> float:
        """Judge a box, 0 to 1."""
        seen = patch(image, box)
        match = max(correlation(seen, self.reference), correlation(seen, self.running), 0.0)
        return 0.5 * (self.colours.similarity(ellipse_counts(image, box)) + match)

    def start_again(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        """Take the running picture from a box where the character was found, if the colours are surely its own.

        After a cut nothing else of the picture is as it was: pose, size, background.
        """
        if self.colours.similarity(ellipse_counts(image, box)) > SURE_COLOURS:
            self.running = patch(image, box)

    def update(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        """Let the running picture follow a box that is surely the character."""
        self.running = (1 - RUNNING_RATE) * self.running + RUNNING_RATE * patch(image, box)


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
