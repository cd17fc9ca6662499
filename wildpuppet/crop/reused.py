"""Recognise drawings that come back: a walk cycle shows the same few drawings again and again, over other backgrounds.

Held drawings are known already (``video/held.py``). Here the first frame of each hold is compared with the drawings
that its shot has shown before: a small description of the character, laid over its middle, says which few may be the
same; features that are followed from one picture to the other give the shift and zoom between them; then the colours
must agree in every small block that either picture's matte says is character, as those of a hold must. Where a matte
takes background for character the blocks differ, so that an old drawing is taken for a new one rather than a new one
for old. As in a hold, what moves by less than a pixel or two is the same drawing.
"""

from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy import ndimage

from wildpuppet.crop.hold import LEAST_FEATURES, LEAST_SHARE, close, shift_and_zoom
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.settings import CropSettings
from wildpuppet.types import Crops
from wildpuppet.video.held import BLOCK, BLUR, LEAST_COVER, largest_change

# The matte where nothing is known: beyond the video's edge, and everywhere when mattes are off.
UNKNOWN = 128
# Pixels count from the first matte on and fully from the second, this many pixels inside the outline.
UNSURE, SURE, INSIDE = 0.5, 0.75, 2
# Frames further apart differ more by what the encoder and the matte make of them, but nothing else may: the threshold
# is this share of the one for holds.
STRICTER = 0.6
# Side of the descriptions, the share of it that the character's size (the root of its area) takes, and the mean
# difference (0..255) from which on no closer look is taken.
DESCRIPTION, FILLED, FARTHEST = 24, 0.4, 16.0
# Closer looks for each drawing, at most: the bound on the cost.
MOST_LOOKS = 3
# Pictures kept at hand; others are read again.
AT_HAND = 12
NUM_FEATURES = 150
# The drawing may come back larger or smaller by so much, and its features lie this close to the common motion.
MOST_ZOOM, FOLLOWS_PIXELS = 1.5, 0.8


@dataclass(frozen=True, eq=False)
class Character:
    """A crop, where its character surely is (0 to 1), the middle of that and its size (the root of its area)."""

    rgb: UInt8[np.ndarray, "H W 3"]
    cover: Float[np.ndarray, "H W"]
    middle: Float[np.ndarray, "2"]
    size: float


def number_reused(crops: Crops, settings: CropSettings, machine: Machine) -> Int[np.ndarray, " T"]:
    """Number the distinct drawings from 0 in the order in which they first appear.

    Frames of one shot that show one drawing have one number, however far apart; frames of two shots never have. With
    ``settings.hold_threshold`` 0 every frame is a drawing of its own.
    """
    recogniser = Recogniser(crops, STRICTER * settings.hold_threshold)
    numbers = np.zeros(len(crops.frames), np.int64)
    for t in range(len(numbers)):
        numbers[t] = numbers[t - 1] if _goes_on(crops, t) else recogniser.number(t)
        machine.progress(t + 1, len(numbers))
    return numbers


def _goes_on(crops: Crops, t: int) -> bool:
    return t > 0 and bool(crops.drawing[t] == crops.drawing[t - 1] and crops.shot[t] == crops.shot[t - 1])


class Recogniser:
    """Knows the drawings that a shot has shown so far."""

    def __init__(self, crops: Crops, threshold: float) -> None:
        self._crops, self._threshold = crops, threshold
        self._shot = -1
        self._next = 0
        self._known: list[tuple[int, int]] = []  # (number, frame that shows it)
        self._descriptions: list[Float[np.ndarray, " D"]] = []
        self._at_hand: OrderedDict[int, Character] = OrderedDict()

    def number(self, t: int) -> int:
        """Give the number of the drawing in frame t, a new one where it was not seen before."""
        if self._crops.shot[t] != self._shot:
            self._shot = int(self._crops.shot[t])
            self._known, self._descriptions = [], []
        if self._threshold <= 0 or self._crops.state[t] == "lost":
            return self._new()
        character = self._character(t)
        if not character.cover.any():
            return self._new()
        description = describe(character)
        for number, first in self._like(description):
            if is_same_drawing(self._character(first), character, self._threshold):
                return number
        self._known.append((self._next, t))
        self._descriptions.append(description)
        return self._new()

    def _new(self) -> int:
        self._next += 1
        return self._next - 1

    def _like(self, description: Float[np.ndarray, " D"]) -> list[tuple[int, int]]:
        """List the few known drawings that are most like one, the likest first."""
        if not self._known:
            return []
        apart = np.array([np.abs(known - description).mean() for known in self._descriptions])
        nearest = np.argsort(apart, kind="stable")[:MOST_LOOKS]
        return [self._known[which] for which in nearest if apart[which] < FARTHEST]

    def _character(self, t: int) -> Character:
        if t not in self._at_hand:
            self._at_hand[t] = character_of(self._crops.images[t : t + 1][0], self._crops.box_crop[t])
            if len(self._at_hand) > AT_HAND:
                self._at_hand.popitem(last=False)
        self._at_hand.move_to_end(t)
        return self._at_hand[t]


def character_of(rgba: UInt8[np.ndarray, "H W 4"], box: Float[np.ndarray, "4"]) -> Character:
    """Find the character by its matte; where no matte was made, all of its box is taken for it."""
    matte = np.where(rgba[..., 3] == UNKNOWN, 0, rgba[..., 3]).astype(np.float32) / 255
    if (rgba[..., 3] == UNKNOWN).all():
        left, top = np.floor(box[:2]).astype(int).clip(0)
        right, bottom = np.ceil(box[:2] + box[2:]).astype(int).clip(0)
        matte[top:bottom, left:right] = 1.0
    cover = ndimage.minimum_filter(np.clip((matte - UNSURE) / (SURE - UNSURE), 0.0, 1.0), 2 * INSIDE + 1)
    area = max(float(cover.sum()), 1.0)
    middle = [cover.sum(axis) @ (np.arange(cover.shape[1 - axis]) + 0.5) / area for axis in (0, 1)]
    return Character(np.ascontiguousarray(rgba[..., :3]), cover, np.array(middle), area**0.5)


def describe(character: Character) -> Float[np.ndarray, " D"]:
    """Shrink a character, its middle in the middle, to ``DESCRIPTION`` squared pixels of covered colour and cover."""
    scale = FILLED * DESCRIPTION / character.size
    shift = DESCRIPTION / 2 - scale * character.middle
    small_from_crop = affine.scale_and_shift(scale, (float(shift[0]), float(shift[1])))
    picture = np.dstack([character.rgb * character.cover[..., None], 255 * character.cover])
    blurred = cv2.blur(picture, (max(1, round(1 / scale)),) * 2)
    small = cv2.warpAffine(blurred, affine.for_opencv(small_from_crop), (DESCRIPTION, DESCRIPTION))
    return np.asarray(small).ravel()


def is_same_drawing(first: Character, second: Character, threshold: float) -> bool:
    """Tell whether two pictures show one drawing, shifted and zoomed as a whole.

    ``threshold`` is the mean change (0..255) of a block that makes another drawing, as for holds.
    """
    second_from_first = motion_between(first, second)
    if second_from_first is None:
        return False
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    matrix, size = affine.for_opencv(second_from_first), first.cover.shape[::-1]
    seen = cv2.warpAffine(second.rgb.astype(np.float32), matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cover = np.maximum(first.cover, cv2.warpAffine(second.cover, matrix, size, flags=flags))
    if ndimage.uniform_filter(cover, BLOCK).max() < LEAST_COVER:
        return False
    return largest_change(_blurred(first.rgb.astype(np.float32)), _blurred(seen), cover) < threshold


def _blurred(rgb: Float[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W 3"]:
    return np.asarray(ndimage.gaussian_filter(rgb, (BLUR, BLUR, 0.0), truncate=3.0))


def motion_between(first: Character, second: Character) -> Float[np.ndarray, "2 3"] | None:
    """Find the shift and zoom that lay the first character on the second; None where its features agree on none."""
    zoom = second.size / first.size
    if not 1 / MOST_ZOOM < zoom < MOST_ZOOM:
        return None
    gray, other = (cv2.cvtColor(one.rgb, cv2.COLOR_RGB2GRAY) for one in (first, second))
    mask = (first.cover > 0.5).astype(np.uint8)
    features = cv2.goodFeaturesToTrack(gray, NUM_FEATURES, 0.005, max(3.0, 0.04 * first.size), mask=mask)
    if features is None:
        return None
    guess = (zoom * (features - first.middle) + second.middle).astype(np.float32)
    after, found, _ = cv2.calcOpticalFlowPyrLK(
        gray, other, features, guess, winSize=(15, 15), maxLevel=2, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    kept = found.ravel() > 0
    before, there = features[kept, 0].astype(np.float64) + 0.5, after[kept, 0].astype(np.float64) + 0.5
    if len(before) < LEAST_FEATURES:
        return None
    # The guess's zoom is undone for the fit, which begins with the commonest shift.
    motion = affine.compose(affine.scale_and_shift(zoom, (0.0, 0.0)), shift_and_zoom(before, there / zoom))
    agree = close(motion, before, there, FOLLOWS_PIXELS).sum()
    return motion if agree >= LEAST_SHARE * len(features) else None
