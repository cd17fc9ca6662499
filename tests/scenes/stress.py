"""One short clip for each thing that makes fitting hard: a six-part doll, drawn with exact truth.

    clip = stress_clip("crossing")

``STRESS`` says for each what is to be seen. Poses are degrees from straight down towards +x, as in ``motion``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from tests.figure import DOLL, Figure, draw_figure
from tests.scenes.film import Film
from tests.scenes.maps import about
from tests.scenes.motion import FIGURE_HEIGHT, camera_at, placed, radians, there_and_back
from tests.scenes.scene import Scene

Size = tuple[int, int]
Degrees = dict[str, float]
NAMES = tuple(part.name for part in DOLL)
HEIGHT = 0.62
"""The doll's share of the picture's height."""
EXPOSURE = (2, 3, 2, 2, 3)
"""Frames for which drawings are held, over and over."""
BOIL = 0.8
"""Canvas pixels by which a line that boils is off, on average."""
SMEAR_AT, SMEAR_PLACES = 0.5, 4


@dataclass(frozen=True, eq=False)
class StressClip:
    """A clip and what a run is told: the box of frame ``at``. In ``smeared`` frames the limbs' drawing is a blur."""

    name: str
    scene: Scene
    at: int
    smeared: tuple[int, ...] = ()

    @property
    def box(self) -> tuple[float, float, float, float]:
        x, y, width, height = (float(side) for side in self.scene.boxes[self.at])
        return x, y, width, height


@cache
def doll(seed: int, identical: bool) -> Figure:
    return draw_figure(seed, identical, DOLL)


def stress_clip(name: str, frames: int | None = None, size: Size = (320, 240), seed: int = 0) -> StressClip:
    """Draw a stress clip; ``frames`` left out: as many as it needs to show what it shows."""
    kind = STRESS[name]
    return kind.film(name, frames or kind.frames, size, seed)


def stride(phase: float) -> Degrees:
    """Arms and legs swing, left against right."""
    swing = np.sin(phase)
    arms = {"right_arm": -6 - 34 * swing, "left_arm": 6 + 34 * swing}
    legs = {"right_leg": 4 + 27 * swing, "left_leg": 4 - 27 * swing}
    return {"torso": 3 * np.sin(2 * phase), "head": 5 * np.sin(phase + 1), **arms, **legs}


def standing(sway: float) -> Degrees:
    """Arms a little off the body, legs apart."""
    limbs = {
        "right_arm": -30 + 4 * sway,
        "left_arm": 30 + 4 * sway,
        "right_leg": -9 + 3 * sway,
        "left_leg": 9 + 3 * sway,
    }
    return {"torso": 2 * sway, "head": 4 * sway, **limbs}


def shares(frames: int) -> np.ndarray:
    """How much of the clip is over in each frame, 0 to 1."""
    return np.arange(frames) / max(frames - 1, 1)


def strides(frames: int, cycles: float = 0.75) -> list[Degrees]:
    return [stride(2 * np.pi * cycles * share) for share in shares(frames)]


def film(
    degrees: Sequence[Degrees],
    size: Size,
    seed: int,
    *,
    x: np.ndarray | float = 0.5,
    scale: np.ndarray | float = 1.0,
    identical: bool = False,
    **more: Any,
) -> Film:
    """A film of the doll standing at ``x`` (shares of the picture's width) with the given angles; the rest is plain."""
    frames = len(degrees)
    world = poses(degrees, size, x, scale)
    figure = doll(seed, identical)
    plain = {
        "camera": np.stack([camera_at("still", 0.0, size)] * frames),
        "order": np.tile(np.arange(len(NAMES)), (frames, 1)),
        "drawing": np.arange(frames),
        "shot": np.zeros(frames, int),
        "art": lambda t: figure.art,
    }
    return Film(size, world, cutout=figure.cutout, seed=seed, **{**plain, **more})


def poses(
    degrees: Sequence[Degrees], size: Size, x: np.ndarray | float = 0.5, scale: np.ndarray | float = 1.0
) -> np.ndarray:
    """world_from_canvas (T, L, 2, 3) of the doll standing at ``x``, its soles near the picture's lower edge."""
    across, larger = (np.broadcast_to(value, len(degrees)) for value in (x, scale))
    grown = larger * HEIGHT * size[1] / FIGURE_HEIGHT
    roots = [(share * size[0], size[1] * 0.92 - 80 * one) for share, one in zip(across, grown, strict=True)]
    return np.stack([placed(DOLL, radians(d), root, one) for d, root, one in zip(degrees, roots, grown, strict=True)])


def crossing(name: str, frames: int, size: Size, seed: int) -> StressClip:
    degrees = []
    for share in shares(frames):
        rise = there_and_back(share / 2)
        legs = {"right_leg": -18 + 40 * rise, "left_leg": 18 - 40 * rise}
        arms = {"right_arm": -45 - 155 * rise, "left_arm": 45 + 155 * rise}
        degrees.append({**standing(0.0), **legs, **arms})
    return StressClip(name, film(degrees, size, seed, identical=True).draw(), 1)


def order(name: str, frames: int, size: Size, seed: int) -> StressClip:
    degrees = [
        {**standing(np.sin(6 * share)), "right_arm": 58 - 125 * there_and_back(share), "left_arm": 112}
        for share in shares(frames)
    ]
    front = list(range(len(NAMES)))
    arm = NAMES.index("right_arm")
    behind = [arm, *(layer for layer in front if layer != arm)]
    orders = np.array([behind if share > 0.5 else front for share in shares(frames)])
    return StressClip(name, film(degrees, size, seed, order=orders).draw(), frames // 3)


def hidden(name: str, frames: int, size: Size, seed: int) -> StressClip:
    tucks = [np.clip(2.0 * there_and_back(share) - 0.3, 0.0, 1.0) for share in shares(frames)]
    degrees = [
        {**standing(np.sin(6 * share)), "left_arm": 45 - 69 * tuck}
        for share, tuck in zip(shares(frames), tucks, strict=True)
    ]
    return StressClip(name, film(degrees, size, seed).draw(), 1)


def pan(name: str, frames: int, size: Size, seed: int) -> StressClip:
    cameras = np.stack([camera_at("pan", share, size) for share in shares(frames)])
    across = 0.5 + 1.1 * (shares(frames) - 0.5)
    return StressClip(name, film(strides(frames), size, seed, x=across, camera=cameras).draw(), frames // 4)


def zoom(name: str, frames: int, size: Size, seed: int) -> StressClip:
    cameras = np.stack([about((size[0] / 2, size[1] * 0.9), 0.7 * 2.0**share, 0.0) for share in shares(frames)])
    return StressClip(name, film(strides(frames), size, seed, camera=cameras).draw(), frames // 4)


def cut(name: str, frames: int, size: Size, seed: int) -> StressClip:
    shot = (np.arange(frames) >= frames // 2).astype(int)
    across, scale = np.where(shot, 0.66, 0.36), np.where(shot, 0.78, 1.0)
    scene = film(strides(frames), size, seed, x=across, scale=scale, shot=shot).draw()
    return StressClip(name, scene, frames // 4)


def twos_and_threes(name: str, frames: int, size: Size, seed: int) -> StressClip:
    held = np.repeat(np.arange(frames), np.resize(EXPOSURE, frames))[:frames]
    degrees = [stride(2 * np.pi * 0.75 * number / held[-1]) for number in held]
    cameras = np.stack([camera_at("still", 0.0, size)] * frames)
    cameras[:, 0, 2] = -0.3 * size[0] * (shares(frames) - 0.5)
    return StressClip(name, film(degrees, size, seed, camera=cameras, drawing=held).draw(), 5)


def smear(name: str, frames: int, size: Size, seed: int) -> StressClip:
    """A dash: between two stances a third of the picture apart there is one drawing, its limbs in many places."""
    blurred = int(SMEAR_AT * frames)
    dash = np.clip((np.arange(frames) - blurred + 2.0) / 4.0, 0.0, 1.0)
    across = 0.34 + 0.32 * dash
    degrees = [
        {**standing(np.sin(6 * share)), "right_arm": -30 + 100 * gone, "right_leg": -9 + 24 * gone}
        for share, gone in zip(shares(frames), dash, strict=True)
    ]
    places = poses(degrees, size, across)
    ways = np.linspace(-0.9, 0.0, SMEAR_PLACES)[:, None, None]
    trail = {
        (blurred, limb): places[blurred, layer] + ways * (places[blurred + 1, layer] - places[blurred, layer])
        for layer, limb in enumerate(NAMES)
        if limb.endswith(("arm", "leg"))
    }
    scene = film(degrees, size, seed, x=across, smears=trail).draw()
    return StressClip(name, scene, 1, (blurred,))


def camouflage(name: str, frames: int, size: Size, seed: int) -> StressClip:
    colours = figure_colours(doll(seed, False))
    across = 0.5 + 0.3 * (shares(frames) - 0.5)
    return StressClip(name, film(strides(frames), size, seed, x=across, ground=colours).draw(), frames // 4)


def figure_colours(figure: Figure) -> np.ndarray:
    """The middle of the lighter and of the darker half of every part's own colours."""
    found = []
    for distance, colour in figure.strokes.values():
        inside = colour[distance < -3.0]
        light = inside.mean(1)
        found += [inside[light >= np.median(light)].mean(0), inside[light < np.median(light)].mean(0)]
    return np.array(found)


def leaving(name: str, frames: int, size: Size, seed: int) -> StressClip:
    """Out to the left in the first half, back from there in the second; gone for a quarter of the clip."""
    there = np.clip(1.35 * (1.0 - np.abs(2 * shares(frames) - 1.0)) - 0.1, 0.0, 1.0)
    return StressClip(name, film(strides(frames, 1.25), size, seed, x=0.36 - 0.56 * there).draw(), 3)


def twins(name: str, frames: int, size: Size, seed: int) -> StressClip:
    """The first passes in front of the second, from left to right."""
    across = 0.27 + 0.46 * shares(frames)
    other = poses([stride(2.0 - 2 * np.pi * share) for share in shares(frames)], size, 1.0 - across)
    return StressClip(name, film(strides(frames), size, seed, x=across, double=other).draw(), 3)


def line_boil(name: str, frames: int, size: Size, seed: int) -> StressClip:
    held = np.arange(frames) // 2 * 2
    figure = doll(seed, False)

    def art(t: int) -> dict[str, np.ndarray]:
        return figure.boiled(np.random.default_rng([seed, int(held[t])]), BOIL)

    degrees = [stride(2 * np.pi * 0.75 * t / frames) for t in held]
    return StressClip(name, film(degrees, size, seed, drawing=held, art=art).draw(), 4)


def colour_change(name: str, frames: int, size: Size, seed: int) -> StressClip:
    """Day turns to a blue dusk; the doll darkens more than what is behind it."""
    dusk = np.array([[0.66, 0.68, 0.85], [0.55, 0.6, 0.8]])
    light = 1.0 + shares(frames)[:, None, None] * (dusk - 1.0)
    return StressClip(name, film(strides(frames), size, seed, light=light).draw(), 3)


def narrow(name: str, frames: int, size: Size, seed: int) -> StressClip:
    return StressClip(name, film(strides(frames, 0.35), size, seed).draw(), 0)


@dataclass(frozen=True)
class Stress:
    """What is to be seen, in so many frames, and how it is drawn."""

    what: str
    frames: int
    film: Callable[[str, int, Size, int], StressClip]


STRESS = {
    "crossing": Stress("arms and legs that look alike cross", 12, crossing),
    "order": Stress("an arm in front of the body goes behind it", 14, order),
    "hidden": Stress("an arm goes behind the body and comes back", 12, hidden),
    "pan": Stress("the camera goes along with a walk", 8, pan),
    "zoom": Stress("the camera zooms to twice the size", 12, zoom),
    "cut": Stress("another place, another size", 10, cut),
    "twos and threes": Stress("held drawings under a moving camera", 12, twos_and_threes),
    "smear": Stress("a dash with one smeared drawing", 8, smear),
    "camouflage": Stress("a background of the character's colours", 12, camouflage),
    "leaving": Stress("out of the picture and back", 22, leaving),
    "twins": Stress("its double passes behind it", 14, twins),
    "line boil": Stress("every drawing has new lines", 8, line_boil),
    "colour change": Stress("dusk falls", 8, colour_change),
    "narrow": Stress("the box is given where the arms lie at the body", 8, narrow),
}
