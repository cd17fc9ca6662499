"""A character of two parts whose drawings are shaded anew in every pose, drawn by OpenCV.

The puppet's parts are flat, as cut from one drawing. In the drawings the body is darker below, the arm is lit by how it
is turned, outlines are dark, and a tuft of hair grows beside the body that the puppet does not have.
"""

from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import Crops, CutOut, Fit, FitState, JointSpec, Part, Puppet

SIDE = 96
FINE = 4
SHOULDER = (52.0, 40.0)
NUM_DRAWINGS = 16
BODY, ARM = (200, 120, 60), (70, 110, 200)


class Shaded(NamedTuple):
    puppet: Puppet
    crops: Crops
    fit: Fit


def ellipse(centre: tuple[float, float], axes: tuple[float, float], degrees: float = 0.0) -> np.ndarray:
    """Cover of an ellipse, 0..1, canvas size."""
    large = np.zeros((SIDE * FINE, SIDE * FINE), np.uint8)
    middle = (round(centre[0] * FINE), round(centre[1] * FINE))
    cv2.ellipse(large, middle, (round(axes[0] * FINE), round(axes[1] * FINE)), degrees, 0, 360, 255, -1)
    return cv2.resize(large, (SIDE, SIDE), interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0


def arm_cover(radians: float, thick: float) -> np.ndarray:
    along = np.array([np.cos(radians), np.sin(radians)])
    centre = np.array(SHOULDER) + 16.0 * along
    return ellipse((float(centre[0]), float(centre[1])), (19.0, thick), float(np.degrees(radians)))


def laid(picture: np.ndarray, cover: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Lay a colour over a premultiplied picture (0..255, alpha 0..1)."""
    paint = np.dstack([np.broadcast_to(colour, (SIDE, SIDE, 3)) * cover[..., None], cover])
    return paint + (1.0 - cover[..., None]) * picture


def drawing(radians: float, is_shaded: bool) -> np.ndarray:
    """One drawing, straight RGBA."""
    picture, rows = np.zeros((SIDE, SIDE, 4)), np.arange(SIDE)[:, None, None]
    body, arm = np.array(BODY, float), np.array(ARM, float)
    if is_shaded:
        picture = laid(picture, ellipse((40.0, 19.0), (4.0, 7.0), 60.0), np.array([30.0, 30.0, 30.0]))
        body = body * (1.1 - 0.5 * (rows - 20.0) / 60.0)
        arm = arm * (0.75 + 0.45 * np.cos(radians - 0.6))
    picture = laid(picture, ellipse((44.0, 50.0), (20.0, 30.0)), body.clip(0, 255))
    if is_shaded:
        picture = laid(picture, arm_cover(radians, 7.0), np.array([20.0, 20.0, 20.0]))
    picture = laid(picture, arm_cover(radians, 5.5 if is_shaded else 7.0), arm.clip(0, 255))
    colour = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    return np.rint(np.dstack([colour, 255.0 * picture[..., 3]])).clip(0, 255).astype(np.uint8)


def part(name: str, cover: np.ndarray, colour: tuple[int, int, int]) -> Part:
    rgb = np.broadcast_to(np.array(colour, np.uint8), (SIDE, SIDE, 3))
    return Part(name, np.dstack([rgb, np.rint(255.0 * cover).astype(np.uint8)]))


def cutout() -> CutOut:
    parts = (part("body", ellipse((44.0, 50.0), (20.0, 30.0)), BODY), part("arm", arm_cover(0.0, 7.0), ARM))
    return CutOut((SIDE, SIDE), parts, (JointSpec(("body", "arm"), SHOULDER),))


def angles() -> np.ndarray:
    return np.linspace(-0.7, 1.3, NUM_DRAWINGS)


@cache
def shaded() -> Shaded:
    """The built puppet, the drawings as crops, and the true vertices as their fit."""
    puppet = build(cutout(), PuppetSettings(edge=0.2))
    is_arm = (puppet.layer_of_vertex == puppet.names.index("arm"))[:, None]
    vertices = []
    for radians in angles():
        cos, sin = np.cos(radians), np.sin(radians)
        turned = (puppet.vertices - SHOULDER) @ np.array([[cos, sin], [-sin, cos]]) + SHOULDER
        vertices.append(np.where(is_arm, turned, puppet.vertices))
    count, numbers = NUM_DRAWINGS, np.arange(NUM_DRAWINGS)
    whole = np.tile(np.eye(2, 3), (count, 1, 1))
    images = np.stack([drawing(float(radians), True) for radians in angles()])
    boxes = np.tile([0.0, 0.0, SIDE, SIDE], (count, 1))
    zeros = np.zeros(count, np.int64)
    crops = Crops(numbers, (SIDE, SIDE), whole, images, boxes, numbers, zeros, ("followed",) * count, None, False)
    states: tuple[FitState, ...] = ("fitted",) * count
    order = np.tile(np.arange(puppet.num_layers), (count, 1))
    fit = Fit(numbers, np.stack(vertices), order, np.ones((count, len(puppet.vertices))), states)
    return Shaded(puppet, crops, fit)
