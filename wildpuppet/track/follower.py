"""One walk in one direction: an OpenCV tracker, our own judgement of its boxes, and the search when it fails."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from wildpuppet.settings import TrackSettings
from wildpuppet.track.appearance import Appearance
from wildpuppet.track.search import find
from wildpuppet.track.trackers import Box, OpenCVTracker
from wildpuppet.types import TrackState

# A searched-for box must look surer than a followed one before it counts as the character.
FOUND_ABOVE_LOST = 0.12
# The running picture learns only from boxes that are surely the character.
SURE_ABOVE_LOST = 0.2


@dataclass(frozen=True)
class Seen:
    """What one frame showed, working pixels."""

    box: Box
    score: float
    state: TrackState


class Follower:
    """Follows from image to image; ``step`` is called once per frame, in the order of the walk."""

    def __init__(
        self,
        maker: Callable[[], OpenCVTracker],
        appearance: Appearance,
        settings: TrackSettings,
        image: UInt8[np.ndarray, "h w 3"],
        box: Box,
    ) -> None:
        self.maker, self.appearance, self.settings = maker, appearance, settings
        self.box = box
        self.is_lost = False
        self.start(image, box)

    def start(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        """Start a fresh tracker on a box."""
        self.tracker = self.maker()
        x, y, w, h = (round(value) for value in box)
        self.tracker.init(image, (x, y, max(w, 2), max(h, 2)))

    def step(self, image: UInt8[np.ndarray, "h w 3"], is_cut: bool) -> Seen:
        """Look at the next frame; ``is_cut``: it belongs to another shot than the last."""
        if is_cut:
            self.is_lost = True
        if self.is_lost:
            return self.look_again(image)
        _, found = self.tracker.update(image)
        box = (float(found[0]), float(found[1]), float(found[2]), float(found[3]))
        score = self.appearance.score(image, box)
        if score < self.settings.lost_score:
            self.is_lost = True
            return self.look_again(image)
        self.box = box
        if score > self.settings.lost_score + SURE_ABOVE_LOST:
            self.appearance.update(image, box)
        return Seen(box, score, "followed")

    def look_again(self, image: UInt8[np.ndarray, "h w 3"]) -> Seen:
        """Search the whole frame; start again where the character surely is."""
        box, score = find(image, self.appearance, self.box[2:])
        if score < self.settings.lost_score + FOUND_ABOVE_LOST:
            return Seen(self.box, score, "lost")
        self.box, self.is_lost = box, False
        self.start(image, box)
        return Seen(box, score, "found")
