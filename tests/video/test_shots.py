import cv2
import numpy as np

from tests.video.clips import encode
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.video.probe import probe
from wildpuppet.video.shots import ChangeMeter, shot_starts

SIZE = (96, 64)
SETTINGS = ProbeSettings()


def starts_of(pictures):
    meter = ChangeMeter(SETTINGS.least_shot_frames)
    return shot_starts(np.stack([meter.measure(picture) for picture in pictures]), SETTINGS)


def scene(seed: int, grey: bool = False) -> np.ndarray:
    """A painted background: big soft shapes."""
    generator = np.random.default_rng(seed)
    small = generator.integers(30, 226, (4, 6, 1 if grey else 3), np.uint8)
    return cv2.resize(np.broadcast_to(small, (4, 6, 3)).copy(), SIZE, interpolation=cv2.INTER_CUBIC)


def shot(seed: int, num_frames: int, hold: int = 2, speed: float = 3.0, grey: bool = False) -> list[np.ndarray]:
    """A character that runs to and fro over a background, drawn once in ``hold`` frames."""
    background, pictures = scene(seed, grey), []
    colour = (220, 220, 220) if grey else (230, 60, 40)
    for t in range(num_frames):
        picture = background.copy()
        centre = (80 - abs(int(speed * (t // hold) * hold) % 120 - 60), 34)
        cv2.ellipse(picture, centre, (11, 22), 10.0 * (t // hold), 0, 360, colour, -1)
        cv2.ellipse(picture, centre, (11, 22), 10.0 * (t // hold), 0, 360, (10, 10, 10), 2)
        pictures.append(picture)
    return pictures


def test_cuts_on_twos_threes_and_in_black_and_white():
    for hold in (1, 2, 3, 4):
        for grey in (False, True):
            pictures = shot(1, 30, hold, grey=grey) + shot(2, 25, hold, grey=grey) + shot(3, 20, hold, grey=grey)
            assert starts_of(pictures) == (0, 30, 55), (hold, grey)


def test_a_flash_is_no_cut_and_one_at_a_cut_is_one():
    pictures = shot(1, 60)
    for flashes in ([24], [24, 25], [10, 40]):
        lit = [np.full_like(p, 255) if t in flashes else p for t, p in enumerate(pictures)]
        assert starts_of(lit) == (0,), flashes
    at_a_cut = [*shot(1, 30), np.full_like(pictures[0], 255), *shot(2, 30)]
    assert len(starts_of(at_a_cut)) == 2
    assert starts_of(at_a_cut)[1] in (30, 31)


def test_fast_pan_zoom_and_fade_are_no_cuts():
    wide = cv2.resize(scene(4), (960, 64), interpolation=cv2.INTER_CUBIC)
    assert starts_of([wide[:, 12 * t : 12 * t + 96] for t in range(60)]) == (0,)
    assert starts_of([wide[:, 24 * (t // 2) : 24 * (t // 2) + 96] for t in range(60)]) == (0,)
    fade = [(picture * min(1.0, t / 24)).astype(np.uint8) for t, picture in enumerate(shot(5, 60))]
    assert starts_of(fade) == (0,)


def test_first_and_last_frames():
    assert starts_of([scene(1)]) == (0,)
    assert starts_of([scene(1)] * 9) == (0,)
    assert starts_of([scene(1)] * 6 + [scene(2)] * 4) == (0, 6)
    assert starts_of([scene(1)] * 2 + [scene(2)] * 9) == (0,), "shorter than a shot may be"


def test_cuts_of_an_encoded_clip(tmp_path):
    pictures = [
        cv2.resize(p, (192, 128), interpolation=cv2.INTER_LINEAR) for p in shot(1, 24) + shot(2, 24) + shot(3, 24)
    ]
    clip = probe(encode(tmp_path / "clip.mp4", pictures, crf="30"), ProbeSettings(), Machine())
    assert clip.shot_starts == (0, 24, 48)
