"""Runs a stress clip as a user would and holds what comes out against the truth.

Points all over the doll are given in frame ``at`` and carried to every other frame. A limb's points have twins at the
same places of the limb on the other side, so that a swap shows.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import wildpuppet
from tests.figure import DOLL, Limb
from tests.scenes import Scene, StressClip, stress_clip, write_clip
from wildpuppet.api import Run
from wildpuppet.correspond.pck import Score, Truth, score
from wildpuppet.puppet.folder import write_cutout
from wildpuppet.types import PointTracks

ALONG = np.linspace(0.1, 1.0, 7)
ACROSS = (-0.5, 0.0, 0.5)
"""Places of a limb's points: shares of its length and of its thickness."""
BODY_SPACING = 9
LEAST_SHARED = 5
"""Two parts' order shows in a frame where they share at least so many points of a grid."""
BOX_PIXELS = 128
"""A little less than the doll has in the picture: more would be slower and say nothing more."""
MOSTLY = 0.6
"""A character of which so much is in the picture must be found; one of which nothing is must be said lost."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A run beside the truth."""

    clip: StressClip
    run: Run
    tracks: PointTracks
    truth: Truth

    @cached_property
    def clear(self) -> np.ndarray:
        """Frames that show the drawing, no smear, and most of the character: where its limbs are can be told."""
        return np.setdiff1d(np.flatnonzero(share_inside(self.clip.scene) > MOSTLY), self.clip.smeared)

    @cached_property
    def score(self) -> Score:
        """In all clear frames."""
        return score(self.truth, self.tracks.points_video, self.tracks.visible, self.clear)

    @cached_property
    def errors(self) -> np.ndarray:
        """Distance from the truth as a share of the character's larger side: (T, N)."""
        distance = np.linalg.norm(self.tracks.points_video - self.truth.points, axis=-1)
        return distance / self.truth.length[:, None]

    def near(self, part: str, share: float = 0.05) -> np.ndarray:
        """Share of a part's points, seen or hidden, that are near the truth, in every frame: (T,)."""
        own = self.truth.part == self.clip.scene.layer(part)
        return (self.errors[:, own] < share).mean(1)

    @cached_property
    def visible_right(self) -> float:
        """How often a point was rightly called seen or not, in percent."""
        others = np.setdiff1d(self.clear, [self.clip.at])
        return 100 * float((self.tracks.visible == self.truth.visible)[others].mean())

    @cached_property
    def order_right(self) -> np.ndarray:
        """Share of the pairs of parts that share pixels and are drawn in the right order, in every frame: (T,)."""
        scene, num_layers = self.clip.scene, len(self.clip.scene.cutout.parts)
        true, found = np.argsort(scene.order, axis=1), np.argsort(self.run.fit.order, axis=1)
        right, counted = np.zeros(len(true)), np.zeros(len(true))
        for layer in range(num_layers):
            for other in range(num_layers):
                shared = scene.shared(scene.points_of(layer), layer, other).sum(1) >= LEAST_SHARED
                shared &= layer != other
                is_same = (true[:, layer] > true[:, other]) == (found[:, layer] > found[:, other])
                right, counted = right + (shared & is_same), counted + shared
        return right / np.maximum(counted, 1)

    @cached_property
    def lost_right(self) -> float:
        """How often the character was rightly called lost or not, in percent of the frames where that is clear."""
        lost = np.array([state == "lost" for state in self.run.fit.state])
        inside = share_inside(self.clip.scene)
        is_clear = (inside == 0.0) | (inside > MOSTLY)
        return 100 * float((lost == (inside == 0.0))[is_clear].mean())


def judge(name: str, folder: Path) -> Judged:
    """Draw a clip, run everything with default settings on crops of its size, carry the points."""
    clip = stress_clip(name)
    video = write_clip(clip.scene, folder / "clip.mp4")
    write_cutout(clip.scene.cutout, folder / "puppet")
    run = wildpuppet.run(
        video, clip.box, at=clip.at, puppet=folder / "puppet", out=folder / "out", store=folder / "store",
        settings={
            "crop": {"box_pixels": BOX_PIXELS},
            "search": {"hinge_drawings": 0},  # the drawn hinges are true; learning them costs half the time
            "out": {"preview": False},
        },
    )  # fmt: skip
    truth = truth_of(clip)
    names = [clip.scene.cutout.parts[layer].name for layer in truth.part]
    return Judged(clip, run, run.carry(truth.points[clip.at], clip.at, names), truth)


def truth_of(clip: StressClip) -> Truth:
    """Where the points are, whether they are seen, and the character's larger side in every frame."""
    scene = clip.scene
    places = [points_on(limb, scene) for limb in DOLL]
    points = np.concatenate([scene.truth(spots, layer) for layer, (spots, _) in enumerate(places)], 1)
    visible = np.concatenate([scene.visible(spots, layer) for layer, (spots, _) in enumerate(places)], 1)
    part = np.concatenate([np.full(len(spots), layer) for layer, (spots, _) in enumerate(places)])
    whole = np.concatenate([scene.truth(scene.points_of(layer), layer) for layer in range(len(DOLL))], 1)
    length = np.ptp(whole, axis=1).max(1)
    return Truth(points, visible, part, clip.at, length, names=tuple(name for _, names in places for name in names))


def points_on(limb: Limb, scene: Scene) -> tuple[np.ndarray, list[str]]:
    """Canvas points of a part and their names; limbs of both sides have the same names but for Left and Right."""
    side, _, kind = limb.name.partition("_")
    if not kind:
        spots = scene.points_of(scene.layer(limb.name), BODY_SPACING)
        return spots, [f"{limb.name} {index}" for index in range(len(spots))]
    (start, end, first, last), *_ = limb.strokes
    way = np.array(end) - start
    sideways = np.array([-way[1], way[0]]) / np.linalg.norm(way)
    spots = [
        start + along * way + across * (first + along * (last - first)) * sideways
        for along in ALONG
        for across in ACROSS
    ]
    return np.array(spots), [f"{side.capitalize()}-{kind} {index}" for index in range(len(spots))]


def share_inside(scene: Scene) -> np.ndarray:
    """How much of the doll is in the picture, in every frame: (T,)."""
    height, width = scene.frames.shape[1:3]
    whole = np.concatenate([scene.truth(scene.points_of(i), i) for i in range(len(scene.cutout.parts))], 1)
    return ((whole >= 0) & (whole < (width, height))).all(-1).mean(1)
