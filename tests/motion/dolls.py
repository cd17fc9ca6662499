"""Puppets whose pose is known by construction: every part turns about its hinge by a given angle.

The chain of turns is written out here, apart from the library's.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from tests.figure import LIMBS, Figure, Limb, draw_figure
from wildpuppet.correspond.pck import Truth
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import Crops, CutOut, Fit, JointSpec, Part, Puppet

SHOULDER, ELBOW, HAND = (60.0, 100.0), (140.0, 100.0), (220.0, 100.0)
ARM_CANVAS = (280, 200)
COARSE = PuppetSettings(edge=0.12)


@dataclass(frozen=True, eq=False)
class Doll:
    """A built puppet with its chain: parent and hinge of each part by name."""

    puppet: Puppet
    parents: Mapping[str, str]
    hinges: Mapping[str, tuple[float, float]]

    def posed(self, turns: Mapping[str, float], place: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Turn each part by so many radians against its parent (x towards y); ``place`` shifts all."""
        vertices = self.puppet.vertices.astype(np.float64).copy()
        for layer, name in enumerate(self.puppet.names):
            mine = self.puppet.layer_of_vertex == layer
            vertices[mine] = self.chain(name, vertices[mine], turns)
        return vertices + np.array(place)

    def chain(self, name: str, points: np.ndarray, turns: Mapping[str, float]) -> np.ndarray:
        while name:
            hinge, angle = np.array(self.hinges[name]), turns.get(name, 0.0)
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            points = (points - hinge) @ turn.T + hinge
            name = self.parents[name]
        return points


@cache
def arm() -> Doll:
    """Two bones of 80 pixels, straight along x at rest."""

    def bone(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
        picture = np.zeros((ARM_CANVAS[1], ARM_CANVAS[0], 4), np.uint8)
        ends = [tuple(int(side) for side in point) for point in (start, end)]
        cv2.line(picture, ends[0], ends[1], (200, 90, 60, 255), 24, cv2.LINE_AA)
        return picture

    parts = (Part("upper", bone(SHOULDER, ELBOW)), Part("lower", bone(ELBOW, HAND)))
    puppet = build(CutOut(ARM_CANVAS, parts, (JointSpec(("upper", "lower"), ELBOW),)), COARSE)
    return Doll(puppet, {"upper": "", "lower": "upper"}, {"upper": SHOULDER, "lower": ELBOW})


@cache
def figure(limbs: tuple[Limb, ...] = LIMBS) -> Doll:
    """The drawn figure of ten limbs, or another."""
    return doll_of(draw_figure(3, identical=False, limbs=limbs), limbs)


def doll_of(drawn: Figure, limbs: tuple[Limb, ...]) -> Doll:
    puppet = build(drawn.cutout, COARSE)
    return Doll(puppet, {limb.name: limb.parent for limb in limbs}, {limb.name: limb.hinge for limb in limbs})


def run_of(doll: Doll, poses: np.ndarray, size: tuple[int, int]) -> tuple[Crops, Fit]:
    """Wrap poses as a run's values: windows that show all, every frame a drawing of its own."""
    count = len(poses)
    numbers, zeros = np.arange(count), np.zeros(count, np.int64)
    whole = np.tile(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), (count, 1, 1))
    low, high = poses.min(1), poses.max(1)
    boxes, images = np.concatenate([low, high - low], 1), np.zeros((count, 1, 1, 4), np.uint8)
    crops = Crops(numbers, size, whole, images, boxes, numbers, zeros, ("followed",) * count, 0)
    order = np.tile(np.arange(doll.puppet.num_layers), (count, 1))
    return crops, Fit(numbers, poses, order, np.ones(poses.shape[:2]), ("fitted",) * count)


def walk(doll: Doll, frames: int, period: float = 16.0, step: float = 5.0) -> np.ndarray:
    """A smooth walk across the picture: arms and legs swing against one another, knees bend on the way forward."""
    poses = []
    for t in range(frames):
        phase = 2 * np.pi * t / period
        swing = np.sin(phase)
        turns = {
            "left_thigh": 0.6 * swing, "right_thigh": -0.6 * swing,
            "left_shin": 0.5 - 0.5 * np.cos(phase), "right_shin": 0.5 + 0.5 * np.cos(phase),
            "left_upper_arm": -0.7 * swing, "right_upper_arm": 0.7 * swing,
            "left_forearm": -0.4 - 0.3 * np.cos(phase), "right_forearm": -0.4 + 0.3 * np.cos(phase),
            "head": 0.1 * np.sin(2 * phase), "torso": 0.08 * swing,
        }  # fmt: skip
        poses.append(doll.posed(turns, (step * t, 4.0 * abs(np.cos(phase)))))
    return np.stack(poses)


def truth_of(doll: Doll, poses: np.ndarray) -> Truth:
    """Every fifth vertex as a point of the truth."""
    chosen = np.arange(0, poses.shape[1], 5)
    visible = np.ones((len(poses), len(chosen)), bool)
    length = np.full(len(poses), float(np.ptp(poses, axis=(0, 1)).max()))
    return Truth(poses[:, chosen], visible, doll.puppet.layer_of_vertex[chosen], 0, length)
