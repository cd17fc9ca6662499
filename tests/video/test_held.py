import cv2
import numpy as np
import pytest

from tests.video.clips import encode
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.video.held import number_drawings
from wildpuppet.video.probe import probe
from wildpuppet.video.read import FrameReader

SIDE = 192
THRESHOLD = 1.5
SUBPIXEL = 4
"""Fractional bits of OpenCV's drawing coordinates."""


def face(mouth: float, arm: float, shift=(0.0, 0.0)) -> np.ndarray:
    """A figure with an outline; ``mouth`` opens by pixels, ``arm`` turns by degrees, all moves by ``shift``."""
    picture = np.full((SIDE, SIDE, 3), (196, 214, 190), np.uint8)

    def place(x, y):
        return round((x + shift[0]) * 2**SUBPIXEL), round((y + shift[1]) * 2**SUBPIXEL)

    def blob(x, y, width, height, colour, line=2):
        axes = round(width * 2**SUBPIXEL), round(height * 2**SUBPIXEL)
        cv2.ellipse(picture, place(x, y), axes, 0, 0, 360, colour, -1, cv2.LINE_AA, SUBPIXEL)
        cv2.ellipse(picture, place(x, y), axes, 0, 0, 360, (20, 16, 24), line, cv2.LINE_AA, SUBPIXEL)

    blob(96, 140, 30, 42, (70, 90, 200))
    hand = 96 + 52 * np.cos(np.radians(arm)), 125 + 52 * np.sin(np.radians(arm))
    cv2.line(picture, place(96, 125), place(*hand), (220, 160, 120), 9, cv2.LINE_AA, SUBPIXEL)
    blob(96, 68, 36, 40, (240, 190, 150))
    blob(82, 60, 6, 8, (255, 255, 255))
    blob(110, 60, 6, 8, (255, 255, 255))
    blob(96, 88, 7, 1.5 + mouth, (120, 30, 40), line=1)
    return picture


def with_matte(pictures, matte=255) -> np.ndarray:
    stack = np.stack(pictures)
    return np.concatenate([stack, np.full((*stack.shape[:3], 1), matte, np.uint8)], axis=-1)


def numbers_of(images, shot=None):
    return number_drawings(images, np.zeros(len(images), int) if shot is None else shot, THRESHOLD).tolist()


ON_TWOS = [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
MOUTHS = [0, 3, 0.5, 4, 1, 3]


def test_holds_on_twos_with_noise_and_a_small_mouth():
    generator = np.random.default_rng(6)
    clean = [face(MOUTHS[drawing], 20) for drawing in ON_TWOS]
    noisy = [np.clip(picture + generator.normal(0, 5, picture.shape), 0, 255).astype(np.uint8) for picture in clean]
    assert numbers_of(with_matte(noisy)) == ON_TWOS


def test_holds_survive_a_low_bit_rate(tmp_path):
    pictures = [face(MOUTHS[drawing], 20 + 10 * drawing) for drawing in ON_TWOS]
    path = encode(tmp_path / "clip.mp4", pictures, crf="32", g="6")
    with FrameReader(probe(path, ProbeSettings(), Machine())) as reader:
        decoded = [picture for _, picture in reader.frames()]
    assert numbers_of(with_matte(decoded, matte=128)) == ON_TWOS


def test_a_drawing_that_drifts_as_a_whole_is_held_and_an_arm_is_not():
    shifts = [(0, 0), (0.4, -0.3), (0.9, -0.6), (1.3, -1.0)]
    assert numbers_of(with_matte([face(2, 20, shift) for shift in shifts])) == [0, 0, 0, 0]
    assert numbers_of(with_matte([face(2, 20), face(2, 24), face(2, 24)])) == [0, 1, 1]


def test_slow_motion_adds_up():
    drawings = numbers_of(with_matte([face(2, 20 + 0.5 * t) for t in range(24)]))
    assert 3 <= drawings[-1] <= 12
    assert set(np.diff(drawings)) == {0, 1}


def test_what_the_matte_leaves_out_does_not_count():
    generator = np.random.default_rng(7)
    images = with_matte([face(2, 20)] * 6, matte=0)
    images[:, 20:185, 55:160, 3] = 255
    outside = images[..., 3] == 0
    images[outside, :3] = generator.integers(0, 256, (outside.sum(), 3))
    assert numbers_of(images) == [0] * 6
    images[..., 3] = 0
    assert numbers_of(images) == [0, 1, 2, 3, 4, 5], "a frame without the character is not a held drawing"


def test_shots_and_the_switch():
    images = with_matte([face(2, 20)] * 6)
    assert numbers_of(images, np.array([0, 0, 0, 1, 1, 1])) == [0, 0, 0, 1, 1, 1]
    assert number_drawings(images, np.zeros(6, int), 0.0).tolist() == list(range(6))


@pytest.mark.parametrize("count", [0, 1])
def test_no_frames_and_one(count):
    assert numbers_of(with_matte([face(2, 20)] * 1)[:count]) == [0] * count
