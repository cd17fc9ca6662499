"""Looking for a lost character over the whole frame.

Two maps are added at a few scales: the correlation with the reference and the running picture, and the mean of
the character's distinctive colours inside a box minus that around it. The best few places are
only proposed; the follower judges them.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.track.appearance import Appearance
from wildpuppet.track.trackers import Box

SCALES = (0.6, 0.72, 0.85, 1.0, 1.18, 1.4)
# Larger side of the character in search pixels: below about 16 correlation says little.
SEARCH_PIXELS = 28
NUM_CANDIDATES = 6


def find(image: UInt8[np.ndarray, "h w 3"], appearance: Appearance, size: tuple[float, float]) -> list[Box]:
    """Return the most likely boxes of about this size, best first."""
    shrink = min(1.0, SEARCH_PIXELS / max(size))
    small = cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    colours = appearance.colours.probability(small)
    candidates: list[tuple[float, Box]] = []
    for scale in SCALES:
        w, h = max(round(size[0] * shrink * scale), 4), max(round(size[1] * shrink * scale), 4)
        if w >= small.shape[1] or h >= small.shape[0]:
            continue
        candidates += peaks(likelihood(small, colours, appearance, (w, h)), (w, h))
    candidates.sort(reverse=True)
    return [(x / shrink, y / shrink, w / shrink, h / shrink) for _, (x, y, w, h) in candidates[:NUM_CANDIDATES]]


def likelihood(
    small: UInt8[np.ndarray, "h w 3"], colours: Float[np.ndarray, "h w"], appearance: Appearance, size: tuple[int, int]
) -> Float[np.ndarray, "y x"]:
    """Map how well a box of ``size`` with its top left corner at each pixel matches."""
    w, h = size
    match = np.full((small.shape[0] - h + 1, small.shape[1] - w + 1), -1.0, np.float32)
    for picture in (appearance.reference, appearance.running):
        template = cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA).clip(0, 255).astype(np.uint8)
        found = cv2.matchTemplate(small, template, cv2.TM_CCOEFF_NORMED)
        match = np.maximum(match, np.nan_to_num(found, nan=-1.0, posinf=-1.0, neginf=-1.0))
    inside = box_mean(colours, (w, h))
    around = box_mean(colours, (min(2 * w, small.shape[1]), min(2 * h, small.shape[0])))
    rows, columns = slice(h // 2, h // 2 + match.shape[0]), slice(w // 2, w // 2 + match.shape[1])
    total: np.ndarray = match + (2 * inside - around)[rows, columns]
    return total


def box_mean(values: Float[np.ndarray, "h w"], size: tuple[int, int]) -> Float[np.ndarray, "h w"]:
    """Average over a box centred on each pixel."""
    mean: np.ndarray = cv2.blur(values, size, borderType=cv2.BORDER_REPLICATE)
    return mean


def peaks(score: Float[np.ndarray, "y x"], size: tuple[int, int], number: int = 2) -> list[tuple[float, Box]]:
    """Take the highest places, each at least half a box from the others."""
    score = score.copy()
    found: list[tuple[float, Box]] = []
    for _ in range(number):
        _, best, _, (x, y) = cv2.minMaxLoc(score)
        found.append((float(best), (float(x), float(y), float(size[0]), float(size[1]))))
        score[max(y - size[1] // 2, 0) : y + size[1] // 2 + 1, max(x - size[0] // 2, 0) : x + size[0] // 2 + 1] = -9.0
    return found
