"""Cycles drawn with exact truth: which drawings come back, over other backgrounds, elsewhere and at another size."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from tests.scene_values import crops_of
from tests.scenes import Scene, make_scene
from wildpuppet.crop.reused import number_reused
from wildpuppet.machine import Machine
from wildpuppet.settings import CropSettings
from wildpuppet.types import Crops

PERIOD, HOLD = 16, 2
DRAWINGS = PERIOD // HOLD
FRAMES = 2 * PERIOD
CYCLE = np.arange(FRAMES) % PERIOD // HOLD
"""Each drawing twice in the clip; the figure walks on, so the second time it stands elsewhere."""
NOISE = 3.0
SAME_PIXELS = 2.0
"""What moves by less beyond the whole figure's motion is the same drawing."""
SIZE = (320, 240)


@cache
def cycle() -> Scene:
    return make_scene("walk", frames=FRAMES, size=SIZE, seed=2, hold=HOLD, cycles=2 - 1 / PERIOD)


def with_pictures(crops: Crops, pictures: np.ndarray) -> Crops:
    """Put other pictures in, with the grain of a scan."""
    grain = np.random.default_rng(4).normal(0, NOISE, pictures.shape)
    grain[..., 3] = 0
    return replace(crops, images=np.clip(pictures + grain, 0, 255).astype(np.uint8))


def numbers_of(crops: Crops, **settings: float) -> list[int]:
    return number_reused(crops, CropSettings(**settings), Machine("cpu")).tolist()


def deformation(points: np.ndarray, first: int, second: int) -> float:
    """How far the figure's points move between two frames beyond one shift and zoom of all."""
    before, after = (points[t] - points[t].mean(0) for t in (first, second))
    zoom = (before * after).sum() / (before**2).sum()
    return float(np.linalg.norm(zoom * before - after, axis=1).max())


def test_a_cycle_shows_its_drawings_again() -> None:
    crops = crops_of(cycle())
    assert numbers_of(with_pictures(crops, crops.images[:])) == CYCLE.tolist()


def test_a_drawing_comes_back_larger() -> None:
    crops = crops_of(cycle())
    larger = np.array([[1.1, 0, -9.0], [0, 1.1, -17.0]])
    pictures = np.array(crops.images[:])
    for t in range(PERIOD, FRAMES):
        pictures[t] = cv2.warpAffine(pictures[t], larger, SIZE, flags=cv2.INTER_CUBIC)
    assert numbers_of(with_pictures(crops, pictures)) == CYCLE.tolist()


def test_drawings_that_differ_are_not_taken_for_one_another() -> None:
    scene = make_scene("walk", frames=24, size=SIZE, seed=4, cycles=1.87)
    points = np.concatenate([scene.truth(scene.points_of(layer, 12), layer) for layer in range(10)], 1)
    seen = np.concatenate([scene.visible(scene.points_of(layer, 12), layer) for layer in range(10)], 1)
    apart = {(a, b): deformation(points[:, seen[a] & seen[b]], a, b) for b in range(24) for a in range(b)}
    assert sum(SAME_PIXELS < pixels < 3 * SAME_PIXELS for pixels in apart.values()) > 5
    crops = crops_of(scene)
    numbers = numbers_of(with_pictures(crops, crops.images[:]))
    assert all(numbers[a] != numbers[b] for (a, b), pixels in apart.items() if pixels > SAME_PIXELS)


def test_a_mouth_that_opens_makes_another_drawing() -> None:
    crops = crops_of(cycle())
    t = PERIOD + 4
    x, y = cycle().truth(np.array([[112.0, 63.5]]), cycle().layer("head"))[t, 0].astype(int)
    pictures = np.array(crops.images[:])
    pictures[t : t + HOLD, y - 2 : y + 4, x - 4 : x + 5, :3] = (120, 20, 30)
    numbers = numbers_of(with_pictures(crops, pictures))
    assert numbers[t : t + HOLD] == [DRAWINGS] * HOLD
    assert numbers[: t - 1] + numbers[t + HOLD :] == CYCLE[: t - 1].tolist() + CYCLE[t + HOLD :].tolist()


def test_shots_lost_frames_and_holds_switched_off() -> None:
    crops, all_new = crops_of(cycle()), (np.arange(FRAMES) // HOLD).tolist()
    assert numbers_of(replace(crops, shot=np.repeat([0, 1], PERIOD))) == all_new
    assert numbers_of(crops, hold_threshold=0.0) == all_new
    lost = replace(crops, state=("followed",) * PERIOD + ("lost",) * HOLD + ("followed",) * (PERIOD - HOLD))
    assert numbers_of(lost)[PERIOD : PERIOD + 2 * HOLD] == [DRAWINGS] * HOLD + [1] * HOLD


def test_over_another_background_nothing_is_recognised_without_a_matte() -> None:
    crops = crops_of(cycle())
    pictures = np.array(crops.images[:])
    pictures[..., 3] = 128
    assert numbers_of(replace(crops, images=pictures)) == (np.arange(FRAMES) // HOLD).tolist()
