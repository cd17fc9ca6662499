"""How figures move: forward kinematics, the gestures of ``make_scene``'s kinds, and cameras."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from tests.figure import LIMBS, NAMES, Limb, Point
from tests.scenes.maps import about, after

Kind = Literal["walk", "crossing", "hidden", "order", "pan", "zoom", "cut", "twos"]
Camera = Literal["still", "pan", "zoom"]
Angles = dict[str, float]

FIGURE_HEIGHT = 200.0
"""Canvas pixels from hair to soles."""


def placed(limbs: Sequence[Limb], angles: Angles, root: Point, scale: float) -> np.ndarray:
    """Forward kinematics: world_from_canvas of every part, (L, 2, 3); the torso's hinge stands at ``root``.

    ``angles`` in radians. Torso and head: turns. Limbs: directions from straight down towards +x, seen from the torso.
    """
    by_name = {part.name: part for part in limbs}
    hip = by_name["torso"].hinge
    shift = np.array([[scale, 0, root[0] - scale * hip[0]], [0, scale, root[1] - scale * hip[1]]])

    def place(name: str) -> np.ndarray:
        part = by_name[name]
        if name == "torso":
            return after(shift, about(part.hinge, 1.0, angles["torso"]))
        if name == "head":
            return after(place("torso"), about(part.hinge, 1.0, angles["head"]))
        own = angles[name] - part.rest_radians
        carried = 0.0 if part.parent == "torso" else angles[part.parent] - by_name[part.parent].rest_radians
        return after(place(part.parent), about(part.hinge, 1.0, carried - own))

    return np.stack([place(part.name) for part in limbs])


def posed(kind: Kind, share: float, size: tuple[int, int], scale: float, camera: Camera, cycles: float) -> np.ndarray:
    """The figure of ``make_scene`` when ``share`` of its clip is over: world_from_canvas, (L, 2, 3)."""
    phase = 2 * np.pi * cycles * share
    travel = 0.0 if kind in ("crossing", "hidden", "order") else (1.1 if camera == "pan" else 0.3) * (share - 0.5)
    root = (size[0] * (0.5 + travel), size[1] * 0.93 - scale * (82 - 3 * abs(np.cos(phase))))
    return placed(LIMBS, _angles(kind, share, phase), root, scale)


def _angles(kind: Kind, share: float, phase: float) -> Angles:
    degrees = {"torso": 3 * np.sin(2 * phase), "head": 5 * np.sin(phase + 1)}
    for side, half in (("right", 0.0), ("left", np.pi)):
        swing = np.sin(phase + half)
        thigh = 30 * swing + 4
        knee = 8 + 38 * max(0.0, np.cos(phase + half)) ** 1.5
        degrees |= {f"{side}_thigh": thigh, f"{side}_shin": thigh - knee}
        degrees |= {f"{side}_upper_arm": -34 * swing - 2, f"{side}_forearm": -34 * swing + 24 - 10 * swing}
    if kind in ("crossing", "hidden", "order"):
        degrees |= _gesture(kind, share, phase)
    return radians(degrees)


def radians(degrees: dict[str, float]) -> Angles:
    return {name: float(np.radians(angle)) for name, angle in degrees.items()}


def _gesture(kind: Kind, share: float, phase: float) -> Angles:
    """Standing figures; the arms do what the kind says."""
    sway = 4 * np.sin(phase)
    standing = {"right_thigh": -9 + sway, "right_shin": -6 + sway, "left_thigh": 9 + sway, "left_shin": 7 + sway}
    rise = there_and_back(share)
    if kind == "crossing":
        right, left = -38 + 95 * rise, 38 - 80 * rise
        return standing | {
            "right_upper_arm": right, "right_forearm": right + 5 + 50 * rise,
            "left_upper_arm": left, "left_forearm": left - 5 - 30 * rise,
            "right_thigh": -10 + 28 * rise, "right_shin": -8 + 22 * rise,
            "left_thigh": 10 - 26 * rise, "left_shin": 8 - 22 * rise,
        }  # fmt: skip
    if kind == "hidden":
        tuck = np.clip(2.2 * rise - 0.4, 0, 1)
        arm = {"left_upper_arm": 36 - 60 * tuck, "left_forearm": 28 - 193 * tuck}
        return standing | arm | {"right_upper_arm": -36 + sway, "right_forearm": -28 + 2 * sway}
    out = -75 * rise  # across the body, out to the side, and back: in front before the middle, behind after it
    across = {"right_upper_arm": 25 + out, "right_forearm": 75 + 1.5 * out}
    return standing | across | {"left_upper_arm": 34 + sway, "left_forearm": 30 + sway}


def there_and_back(share: float) -> float:
    """From 0 to 1 and back to 0, slow at the ends."""
    return float(0.5 - 0.5 * np.cos(2 * np.pi * share))


def layers(kind: Kind, share: float) -> np.ndarray:
    """Layers back to front."""
    names = list(NAMES)
    if kind == "order" and share > 0.5:
        arm = ["right_upper_arm", "right_forearm"]
        names = [name for name in names if name not in arm]
        where = names.index("torso")
        names = names[:where] + arm + names[where:]
    return np.array([NAMES.index(name) for name in names])


def camera_at(kind: Camera, share: float, size: tuple[int, int]) -> np.ndarray:
    """video_from_world."""
    if kind == "pan":
        return np.array([[1.0, 0, size[0] * -0.9 * (share - 0.5)], [0, 1.0, size[1] * 0.06 * np.sin(5 * share)]])
    if kind == "zoom":
        return about((size[0] / 2, size[1] * 0.85), 0.75 + 0.5 * share, 0.0)
    return np.array([[1.0, 0, 0], [0, 1.0, 0]])
