"""Where the picture differs from the shot's background, and how sure that is.

The plate of a shot is a median over time, so a character that hardly moves is part of it. What is known about one box
mends that: outside it, the picture is background, whatever the median says; inside it, what looks like the plate may be
either, and counts as background only once the character has been seen elsewhere. Pictures are the unpadded working
copies, BGR; coordinates are corner-origin.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.geometry import affine
from wildpuppet.track.colours import NUM_BINS, Colours, counted, normalised
from wildpuppet.track.survey import Survey
from wildpuppet.track.trackers import Box

# Misregistration, in pixels, that a difference at an edge of the background may be due to.
LOOSENESS = 0.6
LEAST_NOISE = 3.0
# Levels of trust in the plate: not at all, perhaps the character itself, background.
DOUBTFUL, TRUSTED = 128, 255
# A plate pixel is background when so many pictures show it and their spread is at most this.
LEAST_COUNT, MOST_SPREAD = 3, 14
# The plate shows background inside a claimed box when what differs elsewhere is, in a quarter of the pictures, this
# large beside what differs in the box, and has its colours rather than the plate's by at least so much (Bhattacharyya).
LEAST_AREA, LEAST_MORE_ALIKE = 0.4, 0.12
# It does too when it differs from the picture on at least this share of the box, and is there more like what is around
# the box than the picture is, by as much: then the character has gone from there.
LEAST_GONE = 0.2
# The plate must show something inside the box, its pictures agreeing, on more than this share of it.
LEAST_SHOWN = 0.7
# The plate shows the character when what does not differ in the box has its colours, with log-odds above this, on an
# area of at least this share of what differs.
HELD_COLOUR, MOST_HELD = 0.7, 0.55
# A difference from the plate, in units of noise, that is a change.
CHANGED = 4.0
# The box is widened by this share of its larger side before what is outside counts as background.
GUARD = 0.04
# Log-odds for foreground of a pixel equal to trusted background, and of one that differs much.
SAME, DIFFERENT = -3.0, 4.0
# Where the character hardly leaves its place, other things that move are as likely: its colours must decide.
DIFFERENT_UNSETTLED = 0.7
# The same for doubtful background, once the character has moved away.
SAME_INSIDE, DIFFERENT_INSIDE = -1.5, 0.5


@dataclass(frozen=True)
class Region:
    """A rectangle of whole pixels: left, top and size."""

    left: int
    top: int
    width: int
    height: int

    @property
    def rows(self) -> slice:
        """The rows."""
        return slice(self.top, self.top + self.height)

    @property
    def columns(self) -> slice:
        """The columns."""
        return slice(self.left, self.left + self.width)


@dataclass(frozen=True)
class Foreground:
    """What a comparison with the background says inside a region.

    ``odds`` are log-odds for foreground that hold where the background is ``known``; ``odds_inside`` hold where it is
    doubtful (``was_inside``: a known box stood there), and only if the character has moved away from there.
    """

    odds: Float[np.ndarray, "a b"]
    known: Bool[np.ndarray, "a b"]
    odds_inside: Float[np.ndarray, "a b"]
    was_inside: Bool[np.ndarray, "a b"]


class Scene:
    """Compares pictures of the range with the background of their shot; ``start`` is the range's first frame."""

    def __init__(self, survey: Survey, start: int) -> None:
        self.survey, self.start = survey, start
        self.trust = {shot: trust_of(plate.spread, plate.count) for shot, plate in survey.plates.items()}
        self.background = {shot: plate.colour.copy() for shot, plate in survey.plates.items()}
        self.spread = {shot: plate.spread.copy() for shot, plate in survey.plates.items()}
        self.noise = LEAST_NOISE
        self.claimed: set[int] = set()
        self.settled: set[int] = set()

    def claim(self, picture: UInt8[np.ndarray, "h w 3"], index: int, box: Box) -> None:
        """Learn from a picture in which the character's box is surely known; once per shot, the first time."""
        shot = int(self.survey.shot[index - self.start])
        if shot in self.claimed:
            return
        self.claimed.add(shot)
        plate = self.survey.plates[shot]
        size = plate.colour.shape[1], plate.colour.shape[0]
        plate_from_frame = affine.for_opencv(self.plate_from_frame(index))
        moved = cv2.warpAffine(picture, plate_from_frame, size)
        inside = np.zeros(picture.shape[:2], np.uint8)
        mark_box(inside, box, GUARD)
        is_inside = cv2.warpAffine(inside, plate_from_frame, size) > 0
        in_view = cv2.warpAffine(np.full(picture.shape[:2], 255, np.uint8), plate_from_frame, size) == 255
        deviation = np.maximum(plate.spread, self.noise)
        changed = cv2.absdiff(self.background[shot], moved).max(2) > CHANGED * deviation
        outside, inside_view = in_view & ~is_inside, in_view & is_inside
        trust = self.trust[shot]
        unlike = outside & (changed | (trust == 0))
        self.background[shot][unlike] = moved[unlike]
        self.spread[shot][unlike] = np.minimum(self.spread[shot][unlike], MOST_SPREAD)
        trust[outside] = TRUSTED
        trust[inside_view & (trust > 0)] = DOUBTFUL
        drawn, behind = moved[inside_view & changed], self.background[shot][inside_view & changed]
        is_held = holds_character(drawn, moved[inside_view & ~changed & (trust > 0)], moved[outside])
        is_gone = len(drawn) > LEAST_GONE * inside_view.sum() and continues(behind, moved[outside], drawn)
        is_shown = bool((trust[inside_view] > 0).mean() > LEAST_SHOWN) if inside_view.any() else False
        if is_shown and not is_held and (is_gone or self.walks_about(shot, drawn, behind)):
            trust[inside_view & (trust > 0)] = TRUSTED
            self.settled.add(shot)

    def is_settled(self, index: int) -> bool:
        """Say whether the background is known inside the claimed box too, in the shot of this frame."""
        return int(self.survey.shot[index - self.start]) in self.settled

    def walks_about(self, shot: int, drawn: UInt8[np.ndarray, "n 3"], behind: UInt8[np.ndarray, "n 3"]) -> bool:
        """Say whether the plate shows background inside the claimed box.

        ``drawn`` are the picture's colours where it differs from the plate inside the box, ``behind`` the plate's.
        Either the character covers the background there, or the plate shows the character (which hardly moves) and
        the picture background. What differs from the plate elsewhere, at other times, tells: it has the character's
        colours.
        """
        counts, areas = np.zeros(NUM_BINS), []
        samples = self.survey.samples[shot]
        for row, picture in samples.items():
            region = Region(0, 0, picture.shape[1], picture.shape[0])
            seen = self.foreground(picture, row + self.start, region, (0.0, 0.0, 0.0, 0.0))
            differs = seen.known & (seen.odds > 0)
            counts += counted(picture, differs)
            areas.append(float(differs.sum()))
        if len(drawn) == 0 or np.percentile(areas, 75) < LEAST_AREA * len(drawn):
            return False
        elsewhere = normalised(counts)
        return alike(elsewhere, drawn) > alike(elsewhere, behind) + LEAST_MORE_ALIKE

    def plate_from_frame(self, index: int) -> Float[np.ndarray, "2 3"]:
        """Return the map from frame ``index`` to its shot's plate."""
        row = index - self.start
        plate = self.survey.plates[int(self.survey.shot[row])]
        return affine.compose(plate.plate_from_plane, self.survey.plane_from_frame[row])

    def foreground(self, picture: UInt8[np.ndarray, "h w 3"], index: int, region: Region, box: Box) -> Foreground:
        """Compare a region of a picture with the background; ``box`` is about where the character is."""
        shot = int(self.survey.shot[index - self.start])
        size = region.width, region.height
        shift = affine.scale_and_shift(1.0, (region.left, region.top))
        matrix = affine.for_opencv(affine.compose(self.plate_from_frame(index), shift))
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        plate = cv2.warpAffine(self.background[shot], matrix, size, flags=flags)
        trust = cv2.warpAffine(self.trust[shot], matrix, size, flags=flags)
        spread = cv2.warpAffine(self.spread[shot], matrix, size, flags=flags)
        known = trust > 250
        difference = cv2.absdiff(picture[region.rows, region.columns], plate).astype(np.float32)
        self.measure_noise(difference, known & ~inside_box(region, box, 0.1))
        gray = cv2.cvtColor(plate, cv2.COLOR_BGR2GRAY)
        slope = np.abs(cv2.Sobel(gray, cv2.CV_32F, 1, 0)) + np.abs(cv2.Sobel(gray, cv2.CV_32F, 0, 1))
        variance = self.noise**2 + spread.astype(np.float32) ** 2 + (LOOSENESS / 8 * slope) ** 2
        distance = 0.25 * cv2.blur((difference**2).sum(2) / variance, (3, 3))
        most = DIFFERENT if shot in self.settled else DIFFERENT_UNSETTLED
        odds: np.ndarray = np.clip(SAME + distance, SAME, most)
        doubtful: np.ndarray = np.clip(SAME_INSIDE + distance, SAME_INSIDE, DIFFERENT_INSIDE)
        return Foreground(odds, known, doubtful, (trust >= DOUBTFUL) & ~known)

    def measure_noise(self, difference: Float[np.ndarray, "a b 3"], seen: Bool[np.ndarray, "a b"]) -> None:
        """Follow the typical difference of the background from the plate."""
        if seen.sum() > 100:
            typical = 1.48 * float(np.median(difference[seen][::5]))
            self.noise = 0.8 * self.noise + 0.2 * max(LEAST_NOISE, typical)


def continues(
    behind: UInt8[np.ndarray, "n 3"], around: UInt8[np.ndarray, "k 3"], drawn: UInt8[np.ndarray, "n 3"]
) -> bool:
    """Say whether the colours ``behind`` are more like those ``around`` than ``drawn`` are: background."""
    if len(around) == 0 or len(drawn) == 0:
        return False
    known = normalised(counted(around[None], np.ones((1, len(around)))))
    return alike(known, behind) > alike(known, drawn) + LEAST_MORE_ALIKE


def alike(known: Float[np.ndarray, " bins"], part: UInt8[np.ndarray, "n 3"]) -> float:
    """Compare shares of colours with a part's, 0 to 1 (Bhattacharyya)."""
    return float(np.sqrt(known * normalised(counted(part[None], np.ones((1, len(part)))))).sum())


def holds_character(
    drawn: UInt8[np.ndarray, "n 3"], same: UInt8[np.ndarray, "m 3"], around: UInt8[np.ndarray, "k 3"]
) -> bool:
    """Say whether the plate inside a claimed box shows the character.

    ``drawn`` are the box's colours that differ from the plate, ``same`` those that do not: it does, when many of these
    are the character's too rather than those ``around``. With nothing around, nobody can tell: then it may.
    """
    if len(around) == 0:
        return True
    if len(drawn) == 0 or len(same) == 0:
        return False
    first, second = (counted(part[None], np.ones((1, len(part)))) for part in (drawn, around))
    odds = Colours(first, second).log_odds(same[None])
    return float((odds > HELD_COLOUR).sum()) > MOST_HELD * len(drawn)


def trust_of(spread: UInt8[np.ndarray, "h w"], count: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Trust the plate where enough pictures agree."""
    trusted: np.ndarray = (count >= LEAST_COUNT) & (spread <= MOST_SPREAD)
    return trusted.astype(np.uint8) * TRUSTED


def mark_box(mask: UInt8[np.ndarray, "h w"], box: Box, grow: float) -> None:
    """Fill a box, widened by a share of its larger side, with 255."""
    by = grow * max(box[2:])
    left, top = max(round(box[0] - by), 0), max(round(box[1] - by), 0)
    mask[top : max(round(box[1] + box[3] + by), 0), left : max(round(box[0] + box[2] + by), 0)] = 255


def inside_box(region: Region, box: Box, grow: float) -> Bool[np.ndarray, "a b"]:
    """Mark the region's pixels whose centres lie in a box, widened by a share of its larger side."""
    by = grow * max(box[2:])
    x, y = np.arange(region.width) + region.left + 0.5, np.arange(region.height) + region.top + 0.5
    columns = (x >= box[0] - by) & (x < box[0] + box[2] + by)
    rows = (y >= box[1] - by) & (y < box[1] + box[3] + by)
    marked: np.ndarray = rows[:, None] & columns[None]
    return marked


def region_around(size: tuple[int, int], box: Box, reach: float) -> Region | None:
    """Widen a box by a share of its larger side and round it outwards inside the picture; None if little is left."""
    by = reach * max(box[2:])
    left, top = max(int(box[0] - by), 0), max(int(box[1] - by), 0)
    right, bottom = min(int(box[0] + box[2] + by) + 1, size[0]), min(int(box[1] + box[3] + by) + 1, size[1])
    return Region(left, top, right - left, bottom - top) if min(right - left, bottom - top) >= 4 else None
