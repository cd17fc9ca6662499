"""The background plates that crops are compared with: as ``track/survey.py``, but finer and without the character.

What lies in the character's box does not count in any picture, so the plate never holds the character, however long it
stands still; where the box always stood, nothing is known.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.crop.hold import Steps
from wildpuppet.crop.warp import cut_window
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.track.survey import Survey, samples_per_shot, survey
from wildpuppet.types import Clip, Track
from wildpuppet.video.read import FrameReader

# Pictures kept in all, and per shot at most; with their size they are what bounds the memory.
SAMPLES_IN_ALL, MOST_SAMPLES = 120, 60
# Pixels of a kept picture at most, and of all of them together (four bytes each).
MOST_PIXELS, PIXELS_IN_ALL = 450_000, 50_000_000
# The box is widened by this share of its larger side before what is outside counts as background.
GUARD = 0.05


def plate_scale(clip: Clip, track: Track, crop_from_video: float) -> float:
    """Choose the plate's pixels per video pixel: as fine as the crops, unless memory forbids."""
    kept = len(np.unique(track.shot)) * samples_per_shot(track.shot, SAMPLES_IN_ALL, MOST_SAMPLES)
    most = min(MOST_PIXELS, PIXELS_IN_ALL / kept)
    return min(1.0, crop_from_video, float(np.sqrt(most / (clip.size[0] * clip.size[1]))))


def learn_plates(clip: Clip, track: Track, scale: float, machine: Machine) -> tuple[Survey, Steps]:
    """Look through the tracked frames once; plate pixels are ``scale`` per video pixel.

    Also follows the character's features from frame to frame (``hold.py``).
    """
    first, end = int(track.frames[0]), int(track.frames[-1]) + 1
    size = max(round(clip.size[0] * scale), 1), max(round(clip.size[1] * scale), 1)
    video_from_small = affine.scale_and_shift(1.0 / scale, (0.0, 0.0))
    steps = Steps(track.shot)

    def pictures() -> Iterator[UInt8[np.ndarray, "a b 3"]]:
        for index, rgb in FrameReader(clip).frames(first, end):
            picture = cut_window(rgb, video_from_small, size)
            steps.look(index - first, picture, track.boxes_video[index - first] * scale)
            yield picture

    def covered(t: int) -> UInt8[np.ndarray, "a b"]:
        return box_mask(track.boxes_video[t] * scale, size, GUARD)

    report = partial(report_to, machine, len(track.frames))
    num_samples = samples_per_shot(track.shot, SAMPLES_IN_ALL, MOST_SAMPLES)
    return survey(pictures(), track.shot, covered, report, num_samples), steps


def report_to(machine: Machine, total: int, done: int) -> None:
    """Report progress over the tracked frames."""
    machine.progress(done, total)


def box_mask(box: Float[np.ndarray, "4"], size: tuple[int, int], grow: float) -> UInt8[np.ndarray, "h w"]:
    """Mark a box, widened by a share of its larger side, with 255."""
    mask = np.zeros((size[1], size[0]), np.uint8)
    left, top, right, bottom = grown(box, grow)
    mask[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = 255
    return mask


def grown(box: Float[np.ndarray, "4"], grow: float) -> Int[np.ndarray, "4"]:
    """Widen a box by a share of its larger side and round to left, top, right, bottom."""
    by = grow * box[2:].max()
    sides = np.round([box[0] - by, box[1] - by, box[0] + box[2] + by, box[1] + box[3] + by])
    return np.asarray(sides.astype(np.int64))
