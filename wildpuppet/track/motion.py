"""How the character moves on: where its velocity would carry it, and where around there it looks as it just did.

A tracker that knows looks alone jumps onto a double that comes near. Motion tells the two apart, for things mostly go
on as they went, and so does what was seen in the last frame, the pose included.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.track.trackers import Box

# How readily the velocity follows a new step.
LEARNING = 0.5
# The last frame's look is searched for this far from where it is expected, as a share of the box's larger side.
REACH = 0.3
# Correlation that a place loses when it is as far from the expected one as the larger side is long (squared).
DISTANCE_COST = 4.0
# Another place than the tracker's must be better by so much correlation; the tracker's is good to so many pixels.
CLEARLY, TRACKED_PIXELS = 0.06, 2
# What is compared is the middle of the box, this share of its sides: there is less of the background.
MIDDLE = 0.8


class Motion:
    """The box's velocity and last look; ``look`` is called once per followed frame.

    ``pad``: pixels around the picture proper, which show nothing.
    """

    def __init__(self, image: UInt8[np.ndarray, "h w 3"], box: Box, pad: int) -> None:
        self.velocity = np.zeros(2)
        self.last, self.box, self.pad = image, box, pad

    def look(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        """Go on to the next frame's picture and box."""
        self.velocity += LEARNING * (centre(box) - centre(self.box) - self.velocity)
        self.last, self.box = image, box

    def correction(self, image: UInt8[np.ndarray, "h w 3"], tracked: Box) -> Float[np.ndarray, "2"]:
        """Return by how much ``tracked`` should move to where the last look is found; 0 unless that is clearly better.

        ``tracked`` is the last box as the tracker has carried it.
        """
        low, high = np.full(2, self.pad), np.array(image.shape[1::-1]) - self.pad
        size = np.maximum(np.round(MIDDLE * np.array(self.box[2:])), 4).astype(int)
        corner = np.round(centre(self.box) - size / 2).astype(int)
        reach = round(REACH * max(self.box[2:]))
        expected = centre(self.box) + self.velocity
        start = np.maximum(np.round(expected - size / 2).astype(int) - reach, low)
        end = np.minimum(np.round(expected + size / 2).astype(int) + reach, high)
        if (corner < low).any() or (corner + size > high).any() or (end - start <= size).any():
            return np.zeros(2)
        template = self.last[corner[1] : corner[1] + size[1], corner[0] : corner[0] + size[0]]
        score = cv2.matchTemplate(image[start[1] : end[1], start[0] : end[0]], template, cv2.TM_CCOEFF_NORMED)
        rows, columns = np.indices(score.shape)
        places = np.stack([columns, rows], -1) + start + size / 2
        score -= DISTANCE_COST * (((places - expected) / max(self.box[2:])) ** 2).sum(-1)
        best = np.unravel_index(int(score.argmax()), score.shape)
        near = np.abs(places - centre(tracked)).max(-1) <= TRACKED_PIXELS
        if near.any() and score[best] - score[near].max() < CLEARLY:
            return np.zeros(2)
        return np.asarray(places[best] - centre(tracked))


def centre(box: Box) -> Float[np.ndarray, "2"]:
    """Return a box's centre."""
    return np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])
