"""Two small cut-out figures for drawn scenes: textured parts on a canvas, back to front, with hinges.

``LIMBS`` has ten parts with elbows and knees, ``DOLL`` six with whole arms and legs. The art is painted with distance
fields at ``FINE`` times the canvas, so that edges are smooth at any turn. Nothing here uses the library beyond its
value types: what tests compare against must not come from the code under test.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from wildpuppet.types import CutOut, JointSpec, Part

FINE = 2
CANVAS = (200, 240)
INK = np.array([28.0, 22.0, 26.0])
LINE = 1.6

Point = tuple[float, float]


@dataclass(frozen=True)
class Limb:
    """A tapered stroke through points with radii; ``along`` is where its pattern runs."""

    name: str
    parent: str
    hinge: Point
    strokes: tuple[tuple[Point, Point, float, float], ...]

    @property
    def rest_radians(self) -> float:
        """Angle of the limb at rest from straight down, towards +x."""
        (x0, y0), (x1, y1), _, _ = self.strokes[0]
        return float(np.arctan2(x1 - x0, y1 - y0))


def limb(
    name: str, parent: str, start: Point, end: Point, radii: Point, *more: tuple[Point, Point, float, float]
) -> Limb:
    return Limb(name, parent, start, ((start, end, radii[0], radii[1]), *more))


LIMBS = (
    limb("left_forearm", "left_upper_arm", (137, 121), (153, 154), (8, 6.5), ((154, 158), (156, 162), 9, 8)),
    limb("left_upper_arm", "torso", (116, 90), (137, 121), (10, 8)),
    limb("left_shin", "left_thigh", (117, 178), (120, 212), (9, 7), ((120, 216), (134, 218), 7, 6)),
    limb("left_thigh", "torso", (110, 142), (117, 178), (13, 10)),
    limb("torso", "", (100, 140), (100, 90), (21, 25), ((100, 96), (100, 80), 20, 9)),
    limb("head", "torso", (101, 74), (103, 52), (8, 23), ((106, 42), (94, 36), 14, 12)),
    limb("right_shin", "right_thigh", (83, 178), (80, 212), (9, 7), ((80, 216), (94, 218), 7, 6)),
    limb("right_thigh", "torso", (90, 142), (83, 178), (13, 10)),
    limb("right_upper_arm", "torso", (84, 90), (63, 121), (10, 8)),
    limb("right_forearm", "right_upper_arm", (63, 121), (47, 154), (8, 6.5), ((46, 158), (44, 162), 9, 8)),
)
NAMES = tuple(part.name for part in LIMBS)

DOLL = (
    limb("left_arm", "torso", (116, 90), (150, 148), (10, 6.5), ((151, 152), (153, 156), 9, 8)),
    limb("left_leg", "torso", (110, 142), (120, 212), (13, 7), ((120, 216), (134, 218), 7, 6)),
    limb("torso", "", (100, 140), (100, 90), (21, 25), ((100, 96), (100, 80), 20, 9)),
    limb("head", "torso", (101, 74), (103, 52), (8, 23), ((106, 42), (94, 36), 14, 12)),
    limb("right_leg", "torso", (90, 142), (80, 212), (13, 7), ((80, 216), (94, 218), 7, 6)),
    limb("right_arm", "torso", (84, 90), (50, 148), (10, 6.5), ((49, 152), (47, 156), 9, 8)),
)


@dataclass(frozen=True, eq=False)
class Figure:
    """The cut-out on its canvas, and premultiplied float art (0..255) at ``FINE`` times the canvas.

    ``strokes``: each part's distance from its edge (canvas pixels, negative inside) and its colour without a line.
    """

    cutout: CutOut
    art: dict[str, np.ndarray]
    strokes: dict[str, tuple[np.ndarray, np.ndarray]]

    def boiled(self, hand: np.random.Generator, pixels: float) -> dict[str, np.ndarray]:
        """Trace the outlines anew with an unsteady hand, ``pixels`` off on average; what lies inside stays."""
        traced = {}
        for name, (distance, colour) in self.strokes.items():
            off = smooth_noise(distance.shape, 40, hand)
            traced[name] = _inked(distance + off * (pixels / np.abs(off).mean()), colour)
        return traced


def draw_figure(seed: int, identical: bool, limbs: Sequence[Limb] = LIMBS) -> Figure:
    """Paint the parts; ``identical`` paints left and right alike."""
    strokes, art, parts = {}, {}, []
    for part in limbs:
        twin = part.name.removeprefix("left_").removeprefix("right_") if identical else part.name
        paint = np.random.default_rng([seed, *twin.encode()])
        strokes[part.name] = _painted(part, paint, far=part.name.startswith("left_") and not identical)
        art[part.name] = _inked(*strokes[part.name])
        parts.append(Part(part.name, _straight(art[part.name])))
    joints = tuple(JointSpec((part.parent, part.name), part.hinge) for part in limbs if part.parent)
    return Figure(CutOut(CANVAS, tuple(parts), joints), art, strokes)


def _painted(part: Limb, paint: np.random.Generator, far: bool) -> tuple[np.ndarray, np.ndarray]:
    width, height = FINE * CANVAS[0], FINE * CANVAS[1]
    y, x = (np.mgrid[:height, :width].astype(np.float32) + 0.5) / FINE
    distance = np.minimum.reduce([_capsule(x, y, *stroke) for stroke in part.strokes])
    colour = _pattern(x, y, part, paint, far)
    if part.name == "head":
        colour = _face(x, y, colour)
    return distance, colour


def _inked(distance: np.ndarray, colour: np.ndarray) -> np.ndarray:
    ink = np.clip(0.5 + FINE * (distance + LINE), 0, 1)[..., None]
    alpha = np.clip(0.5 - FINE * distance, 0, 1)[..., None]
    return np.concatenate([(colour * (1 - ink) + INK * ink) * alpha, 255 * alpha], -1).astype(np.float32)


def _capsule(x: np.ndarray, y: np.ndarray, start: Point, end: Point, first: float, last: float) -> np.ndarray:
    (x0, y0), (dx, dy) = start, (end[0] - start[0], end[1] - start[1])
    along = np.clip(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0, 1)
    return np.hypot(x - x0 - along * dx, y - y0 - along * dy) - (first + along * (last - first))


def _pattern(x: np.ndarray, y: np.ndarray, part: Limb, paint: np.random.Generator, far: bool) -> np.ndarray:
    (x0, y0), (x1, y1), _, _ = part.strokes[0]
    length = np.hypot(x1 - x0, y1 - y0)
    along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
    across = ((x - x0) * (y0 - y1) + (y - y0) * (x1 - x0)) / length
    base, second = _colours(paint, 0.62 if far else 1.0)
    period, kind = paint.uniform(9, 15), paint.integers(3)
    if kind == 0:
        second_share = np.sin(2 * np.pi * along / period)
    elif kind == 1:
        second_share = np.sin(2 * np.pi * along / period) * np.sin(2 * np.pi * across / period)
    else:
        second_share = np.hypot((along % period) - period / 2, (across % period) - period / 2) * -1 + period * 0.27
    share = np.clip(0.5 + 1.5 * FINE * second_share, 0, 1)[..., None]
    shade = 1.0 - 0.012 * across - 0.08 * smooth_noise(x.shape, 5, paint)
    return np.clip((base * (1 - share) + second * share) * shade[..., None], 0, 255)


def _colours(paint: np.random.Generator, light: float) -> tuple[np.ndarray, np.ndarray]:
    hue = paint.integers(0, 180)
    pair = np.array([[[hue, 150, 225 * light], [(hue + paint.integers(15, 60)) % 180, 190, 150 * light]]])
    rgb = cv2.cvtColor(pair.astype(np.uint8), cv2.COLOR_HSV2RGB)[0].astype(np.float32)
    return rgb[0], rgb[1]


def _face(x: np.ndarray, y: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Hair, two eyes and a mouth, looking to the right."""
    strokes = [
        (((92, 32), (106, 34), 15.0, 9.0), (92.0, 52.0, 30.0)),
        (((107, 50), (107, 51), 6.0, 6.5), (250.0, 250.0, 245.0)),
        (((119, 50), (119, 51), 4.5, 5.0), (250.0, 250.0, 245.0)),
        (((109, 51), (109, 52), 2.4, 2.4), tuple(INK)),
        (((120.5, 51), (120.5, 52), 2.2, 2.2), tuple(INK)),
        (((107, 64), (117, 63), 1.4, 1.2), (130.0, 20.0, 30.0)),
    ]
    for stroke, fill in strokes:
        share = np.clip(0.5 - FINE * _capsule(x, y, *stroke), 0, 1)[..., None]
        colour = colour * (1 - share) + np.array(fill) * share
    return colour


def _straight(premultiplied: np.ndarray) -> np.ndarray:
    """Down to the canvas, 8-bit RGBA with straight alpha."""
    small = cv2.resize(premultiplied, CANVAS, interpolation=cv2.INTER_AREA)
    alpha = small[..., 3:]
    colour = np.where(alpha > 0, small[..., :3] * 255 / np.maximum(alpha, 1e-3), 0)
    return np.clip(np.concatenate([colour, alpha], -1) + 0.5, 0, 255).astype(np.uint8)


def smooth_noise(shape: tuple[int, ...], cells: int, generator: np.random.Generator) -> np.ndarray:
    """Smooth noise between about -1 and 1."""
    grid = generator.normal(0, 0.5, (cells, cells)).astype(np.float32)
    return cv2.resize(grid, shape[1::-1], interpolation=cv2.INTER_CUBIC)
