"""Two identical arms on one shoulder that close and open again: whether they crossed or turned back, no picture says.

Drawn by OpenCV at twice its size. A keyframe after the meeting decides which arm is which.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from wildpuppet.types import Crops, CutOut, JointSpec, Part

CANVAS, SIZE, FRAMES = (96, 96), (112, 96), 9
SHOULDER, HAND = (48.0, 36.0), (48.0, 78.0)
PLACE = np.array([[1.0, 0, 8.0], [0, 1.0, 4.0]])
BODY = (90, 150, 230)
SWING = np.radians([44, 30, 16, 3, 13, 24, 35, 46, 57])
"""Half the angle between the arms."""
FINE = 2


def paint(names: tuple[str, ...]) -> np.ndarray:
    """Draw parts at rest, RGBA at ``FINE`` times the canvas."""
    picture = np.zeros((FINE * CANVAS[1], FINE * CANVAS[0], 4), np.uint8)
    (x, y), (_, tip) = SHOULDER, HAND
    if "body" in names:
        centre = (round(FINE * x), round(FINE * (y - 12)))
        cv2.circle(picture, centre, FINE * 15, (*BODY, 255), -1, cv2.LINE_AA)
        cv2.circle(picture, (centre[0] - 9, centre[1] - 6), 5, (250, 240, 60, 255), -1, cv2.LINE_AA)
        cv2.circle(picture, (centre[0] + 11, centre[1] + 4), 4, (40, 60, 90, 255), -1, cv2.LINE_AA)
    if "arm" in names:
        ends = [(round(FINE * x), round(FINE * end)) for end in (y, tip - 4)]
        cv2.line(picture, *ends, (200, 60, 50, 255), FINE * 9, cv2.LINE_AA)
        cv2.circle(picture, ends[1], FINE * 7, (240, 200, 120, 255), -1, cv2.LINE_AA)
        for share in (0.25, 0.5):
            at = round(FINE * (y + share * (tip - y)))
            cv2.line(picture, (ends[0][0] - 9, at), (ends[0][0] + 9, at), (60, 20, 70, 255), 4, cv2.LINE_AA)
    return picture


def about_shoulder(radians: float) -> np.ndarray:
    """Video from canvas of an arm that is turned by so much from straight down, towards +x."""
    turn = np.array([[np.cos(radians), np.sin(radians)], [-np.sin(radians), np.cos(radians)]])
    middle = PLACE[:, :2] @ SHOULDER + PLACE[:, 2]
    return np.column_stack([turn, middle - turn @ SHOULDER])


def cutout() -> CutOut:
    """The puppet: a body and two arms that differ in nothing but their names."""

    def small(names: tuple[str, ...]) -> np.ndarray:
        return cv2.resize(paint(names), CANVAS, interpolation=cv2.INTER_AREA)

    arm = small(("arm",))
    parts = (Part("body", small(("body",))), Part("first", arm), Part("second", arm))
    joints = tuple(JointSpec(("body", name), SHOULDER) for name in ("first", "second"))
    return CutOut(CANVAS, parts, joints)


@dataclass(frozen=True, eq=False)
class Arms:
    """The clip: ``crops`` are whole frames."""

    crops: Crops

    def maps(self, first_is_right: np.ndarray) -> np.ndarray:
        """Truth, video from canvas (T, 3, 2, 3), for either story: is ``first`` the right arm in each frame?"""
        side = np.where(first_is_right, 1.0, -1.0)
        arms = [
            [about_shoulder(sign * way * swing) for way, swing in zip(side, SWING, strict=True)] for sign in (1, -1)
        ]
        return np.stack([np.repeat(PLACE[None], FRAMES, 0), *map(np.stack, arms)], 1)


def draw() -> Arms:
    """Draw the clip over grain."""
    grain = np.random.default_rng(3).normal(0, 6, (FINE * SIZE[1], FINE * SIZE[0], 1))
    ground = np.clip(np.full((*grain.shape[:2], 3), (120.0, 130, 110)) + grain, 0, 255)
    frames = np.stack([_picture(ground, swing) for swing in SWING])
    boxes = np.array([cv2.boundingRect((frame[..., 3] > 128).astype(np.uint8)) for frame in frames], float)
    identity = np.tile(np.array([[1.0, 0, 0], [0, 1.0, 0]]), (FRAMES, 1, 1))
    number = np.arange(FRAMES)
    return Arms(Crops(number, SIZE, identity, frames, boxes, number, np.zeros(FRAMES, int), ("followed",) * FRAMES, 0))


def _picture(ground: np.ndarray, swing: float) -> np.ndarray:
    shown = np.dstack([ground, np.zeros(ground.shape[:2])])
    for names, place in (("body", PLACE), ("arm", about_shoulder(swing)), ("arm", about_shoulder(-swing))):
        rgba = paint((names,)).astype(np.float32)
        rgba[..., :3] *= rgba[..., 3:] / 255
        matrix = np.column_stack([place[:, :2], FINE * place[:, 2] + (place[:, :2] @ [0.5, 0.5] - 0.5)])
        warped = cv2.warpAffine(rgba, matrix, (FINE * SIZE[0], FINE * SIZE[1]))
        shown = shown * (1 - warped[..., 3:] / 255) + warped
    return np.clip(cv2.resize(shown, SIZE, interpolation=cv2.INTER_AREA) + 0.5, 0, 255).astype(np.uint8)
