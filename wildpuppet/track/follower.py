"""One walk in one direction.

An OpenCV tracker says where the character went; what differs from the learnt background and has the character's
colours (``scene.py``, ``appearance.py``) says how far it reaches, side by side; where both disagree for a while the
tracker starts again. Our own score judges the box, and a lost character is looked for over the whole frame.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.settings import TrackSettings
from wildpuppet.track.appearance import Appearance
from wildpuppet.track.evidence import Evidence, gather
from wildpuppet.track.extent import measure, piece_boxes, pulled
from wildpuppet.track.growth import growth_between
from wildpuppet.track.motion import Motion
from wildpuppet.track.scene import Region, Scene, region_around
from wildpuppet.track.search import find
from wildpuppet.track.trackers import Box, OpenCVTracker
from wildpuppet.types import TrackState

# A searched-for box must look surer than a followed one before it counts as the character.
FOUND_ABOVE_LOST = 0.15
# The running picture learns only from boxes that are surely the character.
SURE_ABOVE_LOST = 0.2
# Share of the score that the foreground decides where the background is known.
PRESENCE_WEIGHT = 0.5
# The background is compared this far beyond the predicted box, as a share of its larger side.
REACH = 0.3
# The box is moved to where the foreground is only if the character has surely moved away.
LEAST_AWAY = 0.5
# A side follows its measurement by this share, and by at most this share of the box in one frame.
GAIN, MOST_CHANGE = 0.8, 0.15
# All sides together move it by at most this share of its larger side: more is something else that touches it.
MOST_SHIFT = 0.1
# Where the character hardly leaves its place, a box grows by at most this factor over its remembered size, which
# follows slowly.
MOST_GROWTH, MEMORY_RATE = 1.2, 0.03
# OpenCV's trackers want a box at least so many pixels large, and not thinner than one to so many.
LEAST_SIDE, THINNEST = 10.0, 4.0
# The tracker starts again when its box overlaps the measured one less than this for so many frames.
AGREEMENT, PATIENCE = 0.55, 3


@dataclass(frozen=True)
class Seen:
    """What one frame showed, working pixels."""

    box: Box
    score: float
    state: TrackState


class Follower:
    """Follows from image to image; ``step`` is called once per frame, in the order of the walk.

    Images are padded working copies; boxes are in their pixels.
    """

    def __init__(
        self,
        maker: Callable[[], OpenCVTracker],
        appearance: Appearance,
        scene: Scene,
        settings: TrackSettings,
        image: UInt8[np.ndarray, "h w 3"],
        box: Box,
        pad: int,
    ) -> None:
        self.maker, self.appearance, self.scene = maker, appearance, scene
        self.settings, self.pad = settings, pad
        self.is_lost = False
        self.size = np.array(box[2:])
        self.gray: UInt8[np.ndarray, "h w"] | None = None
        self.start(image, box)
        self.motion = Motion(image, box, self.pad)

    def start(self, image: UInt8[np.ndarray, "h w 3"], box: Box) -> None:
        """Start a fresh tracker on a box."""
        self.tracker = self.maker()
        self.box, self.tracked = box, kept_inside(trackable(box), image.shape)
        x, y, w, h = (int(value) for value in self.tracked)
        self.tracker.init(image, (x, y, w, h))
        self.disagreements = 0

    def step(self, image: UInt8[np.ndarray, "h w 3"], index: int, is_cut: bool) -> Seen:
        """Look at the next frame; ``is_cut``: it belongs to another shot than the last."""
        self.is_lost = self.is_lost or is_cut
        return self.look_again(image, index) if self.is_lost else self.follow(image, index)

    def follow(self, image: UInt8[np.ndarray, "h w 3"], index: int) -> Seen:
        """Ask the tracker, then measure how far the character reaches."""
        _, found = self.tracker.update(image)
        tracked = (float(found[0]), float(found[1]), float(found[2]), float(found[3]))
        grown = self.growth(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), index)
        carried_on = carried(self.box, self.tracked, tracked, grown)
        dx, dy = (float(step) for step in self.motion.correction(image, carried_on))
        predicted = (carried_on[0] + dx, carried_on[1] + dy, carried_on[2], carried_on[3])
        if dx or dy:
            self.disagreements = PATIENCE
        self.tracked = tracked[0] + dx, tracked[1] + dy, tracked[2], tracked[3]
        evidence = self.evidence(image, index, predicted)
        box = predicted if evidence is None else self.measured(image, evidence, index, predicted)
        look, score = self.judge(image, evidence, box)
        if score < self.settings.lost_score:
            self.is_lost = True
            return self.look_again(image, index)
        self.box = box
        self.motion.look(image, box)
        if self.disagreements >= PATIENCE:
            self.start(image, box)
        elif look > self.settings.lost_score + SURE_ABOVE_LOST:
            self.appearance.update(image, box)
        return Seen(box, score, "followed")

    def growth(self, gray: UInt8[np.ndarray, "h w"], index: int) -> float:
        """Return the character's growth since the last frame; 1 where its sides are measured well without it."""
        grown = 1.0
        if self.gray is not None and not self.scene.is_settled(index):
            grown = growth_between(self.gray, gray, self.box)
        self.gray = gray
        self.size = self.size * grown
        return grown

    def evidence(self, image: UInt8[np.ndarray, "h w 3"], index: int, box: Box) -> Evidence | None:
        """Gather what background and colour say around a box; None where it lies outside the frame."""
        picture = self.inner(image)
        region = region_around((picture.shape[1], picture.shape[0]), shifted(box, -self.pad), REACH)
        if region is None:
            return None
        return gather(picture, index, self.scene, self.appearance.colours, region, shifted(box, -self.pad))

    def inner(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "a b 3"]:
        """Take the padding off."""
        return image[self.pad : image.shape[0] - self.pad, self.pad : image.shape[1] - self.pad]

    def measured(self, image: UInt8[np.ndarray, "h w 3"], evidence: Evidence, index: int, predicted: Box) -> Box:
        """Move the predicted box to the foreground, or each of its sides towards the foreground's edge."""
        inner = shifted(predicted, -self.pad)
        surely_away = evidence.moved_away > LEAST_AWAY
        better = pulled(np.clip(evidence.odds / 4.0, -0.4, 1.0), evidence.region, inner)
        if surely_away and better != inner and self.looks_better(image, shifted(better, self.pad), predicted):
            self.disagreements = PATIENCE
            return shifted(better, self.pad)
        extent = measure(evidence.mask(inner), evidence.colour, evidence.region, inner)
        if extent is None:
            return predicted
        found, free = extent
        change = np.where(free, to_sides(found) - to_sides(inner), 0.0)
        if not self.scene.is_settled(index):
            change = self.held_back(change, evidence, inner)
        shift = np.tile((change[:2] + change[2:]) / 2, 2)
        most = MOST_SHIFT * max(predicted[2:])
        change = change - shift + np.clip(shift, -most, most)
        limit = MOST_CHANGE * np.array([predicted[2], predicted[3]] * 2)
        left, top, right, bottom = to_sides(predicted) + np.clip(GAIN * change, -limit, limit)
        box = (float(left), float(top), float(right - left), float(bottom - top))
        self.size = (1 - MEMORY_RATE) * self.size + MEMORY_RATE * np.array(box[2:])
        self.disagreements = self.disagreements + 1 if overlap(self.tracked, trackable(box)) < AGREEMENT else 0
        return box

    def looks_better(self, image: UInt8[np.ndarray, "h w 3"], box: Box, than: Box) -> bool:
        """Say whether a box looks more like the character than another."""
        return self.appearance.score(image, box) > self.appearance.score(image, than)

    def held_back(self, change: Float[np.ndarray, "4"], evidence: Evidence, box: Box) -> Float[np.ndarray, "4"]:
        """Where the character hardly leaves its place, let sides move out only against little that moves behind.

        And keep the size near what it was for a while. ``change`` moves left, top, right, bottom.
        """
        outward = change * np.array([-1.0, -1.0, 1.0, 1.0]) > 0
        change = np.where(outward & evidence.crowded(box), 0.0, change)
        sizes = np.array(box[2:]) + change[2:] - change[:2]
        own = evidence.own_strips(box, change)
        surplus = np.maximum(sizes - np.maximum(MOST_GROWTH * self.size, box[2:]), 0.0)
        growth = np.where(outward & ~own, np.abs(change), 0.0)
        total = np.maximum(growth[:2] + growth[2:], 1e-9)
        return change * np.where(outward & ~own, 1.0 - np.tile(np.minimum(surplus / total, 1.0), 2), 1.0)

    def judge(self, image: UInt8[np.ndarray, "h w 3"], evidence: Evidence | None, box: Box) -> tuple[float, float]:
        """Return how much a box looks like the character, and the same with what the background says."""
        look = self.appearance.score(image, box)
        presence, share = (0.0, 0.0) if evidence is None else evidence.presence(shifted(box, -self.pad))
        weight = PRESENCE_WEIGHT * share
        return look, (1 - weight) * look + weight * presence

    def look_again(self, image: UInt8[np.ndarray, "h w 3"], index: int) -> Seen:
        """Search the whole frame; start again where the character surely is."""
        picture = self.inner(image)
        everywhere = Region(0, 0, picture.shape[1], picture.shape[0])
        evidence = gather(picture, index, self.scene, self.appearance.colours, everywhere, shifted(self.box, -self.pad))
        boxes = find(picture, self.appearance, self.box[2:])
        boxes += piece_boxes(evidence.known & (evidence.odds > 0), self.box[2:])
        candidates = [shifted(box, self.pad) for box in boxes]
        scored = [(self.judge(image, evidence, box)[1], box) for box in candidates]
        score, box = max(scored, default=(0.0, self.box))
        if score < self.settings.lost_score + FOUND_ABOVE_LOST:
            return Seen(self.box, score, "lost")
        self.is_lost = False
        self.appearance.start_again(image, box)
        whole = completed(shifted(box, -self.pad), self.size, (everywhere.width, everywhere.height))
        box = shifted(whole, self.pad)
        self.start(image, box)
        self.motion = Motion(image, box, self.pad)
        self.size = np.array(box[2:])
        self.gray = None
        self.scene.claim(picture, index, shifted(box, -self.pad))
        return Seen(box, score, "found")


def shifted(box: Box, by: float) -> Box:
    """Move a box along the diagonal."""
    return box[0] + by, box[1] + by, box[2], box[3]


def trackable(box: Box) -> Box:
    """Widen a box that is too small or too thin for OpenCV's trackers, about its centre."""
    x, y, w, h = box
    wide, high = max(w, h / THINNEST, LEAST_SIDE), max(h, w / THINNEST, LEAST_SIDE)
    return x - (wide - w) / 2, y - (high - h) / 2, wide, high


def completed(box: Box, size: Float[np.ndarray, "2"], picture: tuple[int, int]) -> Box:
    """Let a box that ends at one edge of the picture go on beyond it: what comes in shows a part of itself first."""
    sides = to_sides(box)
    for axis in (0, 1):
        at_start, at_end = sides[axis] <= 1, sides[axis + 2] >= picture[axis] - 1
        if at_start and not at_end:
            sides[axis] = min(sides[axis], sides[axis + 2] - size[axis])
        elif at_end and not at_start:
            sides[axis + 2] = max(sides[axis + 2], sides[axis] + size[axis])
    left, top, right, bottom = (float(side) for side in sides)
    return left, top, right - left, bottom - top


def kept_inside(box: Box, shape: tuple[int, ...]) -> Box:
    """Move a box into the image; OpenCV's trackers cannot begin beyond its edge."""
    wide, high = min(box[2], shape[1] - 1.0), min(box[3], shape[0] - 1.0)
    return min(max(box[0], 0.0), shape[1] - 1.0 - wide), min(max(box[1], 0.0), shape[0] - 1.0 - high), wide, high


def carried(box: Box, before: Box, after: Box, grown: float) -> Box:
    """Move a box as the tracker's box moved and let it grow; the rest is left to the measurement."""
    x = box[0] + box[2] / 2 + after[0] + after[2] / 2 - before[0] - before[2] / 2
    y = box[1] + box[3] / 2 + after[1] + after[3] / 2 - before[1] - before[3] / 2
    w, h = grown * box[2], grown * box[3]
    return x - w / 2, y - h / 2, w, h


def to_sides(box: Box) -> np.ndarray:
    """Return left, top, right, bottom."""
    return np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]])


def overlap(first: Box, second: Box) -> float:
    """Intersection over union."""
    a, b = to_sides(first), to_sides(second)
    shared = float(np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0)))
    return shared / max(first[2] * first[3] + second[2] * second[3] - shared, 1e-9)
