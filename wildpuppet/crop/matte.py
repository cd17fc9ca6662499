"""A soft matte for each crop: how surely each pixel is the character, as log-odds of three witnesses.

- The background plate: a pixel that looks as the plate does is background, one that differs is foreground. How much a
  difference says is measured in each crop: where things other than the character move around its box, differences are
  common there too and say little.
- Colour: how much likelier the colour is on the character than around it, learnt over the whole clip.
- Place: inside the box, a little; far outside, against.

Where no plate is known (the box always stood there, the camera's motion could not be found) colour and place remain,
which never make a matte sure. 128 is even odds.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.crop.light import in_one_light, light_between, without_light
from wildpuppet.crop.plate import GUARD, box_mask
from wildpuppet.geometry import affine
from wildpuppet.track.colours import NUM_BINS, Colours, colour_bins, normalised
from wildpuppet.track.plate import Plate, median_plate
from wildpuppet.track.survey import Survey
from wildpuppet.types import Track

# Plate pixels count from so many pictures on, fully from FULL_COUNT, and not where the pictures differ by more.
LEAST_COUNT, FULL_COUNT, MOST_SPREAD = 2, 6, 24
# Misregistration, in pixels, that a difference at an edge of the background may be due to.
LOOSENESS = 0.7
LEAST_NOISE = 2.5
# Share of the character's pixels that look as the background behind them, and that differ clearly.
CAMOUFLAGED, DIFFERING = 0.07, 0.9
# How common differences around the box are taken to be, at least and at most, and how far that reaches: the standard
# deviation as a share of the box's larger side.
LEAST_CLUTTER, MOST_CLUTTER, CLUTTER_REACH = 0.004, 0.9, 0.15
# Squared difference, in units of noise, at which a pixel changes from "same" to "differs", and the width of the change.
TURNING_POINT, TURNING_WIDTH = 16.0, 5.0
# An edge pixel counts as background when the character covers no more of it than this, fully as the character from one
# minus this on.
LEAST_COVER = 0.3
# Log-odds of place inside the box, and far outside it, reached at FAR of its larger side.
PLACE_INSIDE, PLACE_OUTSIDE, FAR = 0.4, -2.5, 0.25
# Weight of the colours' log-odds, and the least and most that they can say.
COLOUR_WEIGHT, LEAST_COLOUR, MOST_COLOUR = 0.8, -4.0, 2.2
# Learning colours: weight of pixels of the box whose background is not known.
UNSURE = 0.4
# Rounds of learning in which the colours themselves say what is the character where the background is not known.
ROUNDS = 3
# Share of the pictures, those with most of it, that do not count when a colour of the character is learnt.
LEFT_OUT = 0.3
# Guessing what is behind the box: log-odds of colour that speak against the character, the share of the pictures that
# must agree, and how far such a guess counts as known.
BACKGROUND_COLOUR, LEAST_GUESSED, GUESSED = -0.4, 0.2, 0.5
# This far from the box, in units of its larger side, everything counts as around the character.
SURELY_OUTSIDE = 0.1
# Edge-preserving smoothing: radius in crop pixels and the change of grey (0..1), squared, that counts as an edge.
GUIDE_RADIUS, GUIDE_EDGE = 3, 4e-4


@dataclass(frozen=True, eq=False)
class Comparison:
    """What the plate says about a crop.

    ``distance`` is the squared difference in units of noise, ``cover`` (0..1) what the difference is beside the
    largest nearby: about the share of an edge pixel that the character covers. ``known``: how far the plate is.
    ``picture`` is the crop in the plate's light.
    """

    distance: Float[np.ndarray, "H W"]
    cover: Float[np.ndarray, "H W"]
    known: Float[np.ndarray, "H W"]
    picture: UInt8[np.ndarray, "H W 3"]


@dataclass(frozen=True, eq=False)
class Behind:
    """A shot's background as the matte uses it, on the plate's canvas; ``known`` is 0..1."""

    colour: UInt8[np.ndarray, "h w 3"]
    spread: UInt8[np.ndarray, "h w"]
    known: Float[np.ndarray, "h w"]


@dataclass(frozen=True, eq=False)
class View:
    """The pixels near the box of one kept picture.

    ``weight`` is the probability of the character where the background ``is_known``; ``away`` how far from the box.
    """

    bins: Int[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]
    is_known: Bool[np.ndarray, " n"]
    away: Float[np.ndarray, " n"]


class Matter:
    """Makes mattes; ``scale`` is the plates' pixels per video pixel."""

    def __init__(self, track: Track, survey: Survey, scale: float) -> None:
        self.track, self.scale = track, scale
        self.survey, self.changing_light = in_one_light(survey, lambda t: self.outside(t, survey))
        survey = self.survey
        self.behind = {
            shot: Behind(plate.colour, plate.spread, known_share(plate)) for shot, plate in survey.plates.items()
        }
        self.colours = self.learn_colours()
        self.behind = {shot: self.completed(shot) for shot in survey.plates}

    def matte(
        self, t: int, crop: UInt8[np.ndarray, "H W 3"], video_from_crop: Float[np.ndarray, "2 3"]
    ) -> UInt8[np.ndarray, "H W"]:
        """Return 255 surely the character, 0 surely not, 128 unknown."""
        box = box_in_crop(self.track.boxes_video[t], video_from_crop)
        away = distance_from_box(box, crop.shape[:2])
        seen = self.compare(t, crop, video_from_crop, away)
        clutter = clutter_of(seen, away, box)
        odds = plate_odds(seen, clutter)
        odds += np.clip(COLOUR_WEIGHT * self.colours.log_odds(seen.picture[..., ::-1]), LEAST_COLOUR, MOST_COLOUR)
        odds += place_odds(away)
        smooth = smoothed(odds, crop)
        matte: np.ndarray = np.round(255.0 / (1.0 + np.exp(-smooth))).astype(np.uint8)
        return matte

    def compare(
        self,
        t: int,
        crop: UInt8[np.ndarray, "H W 3"],
        video_from_crop: Float[np.ndarray, "2 3"],
        away: Float[np.ndarray, "H W"],
    ) -> Comparison:
        """Compare a crop with its shot's plate."""
        shot = int(self.track.shot[t])
        plate, behind = self.survey.plates[shot], self.behind[shot]
        plate_from_small = affine.compose(plate.plate_from_plane, self.survey.plane_from_frame[t])
        matrix = affine.for_opencv(affine.compose(plate_from_small, self.scale * video_from_crop))
        size = crop.shape[1], crop.shape[0]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        colour = cv2.warpAffine(behind.colour, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        spread = cv2.warpAffine(behind.spread, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        known = cv2.warpAffine(behind.known, matrix, size, flags=flags)
        background = (known > 0.99) & (away > 0.03)
        if shot in self.changing_light:
            crop = without_light(crop, light_between(crop, colour, background))
        difference = cv2.absdiff(crop, colour).astype(np.float32)
        gray = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
        slope = np.abs(cv2.Sobel(gray, cv2.CV_32F, 1, 0)) + np.abs(cv2.Sobel(gray, cv2.CV_32F, 0, 1))
        noise = noise_of(difference, background)
        variance = noise**2 + spread.astype(np.float32) ** 2 + (LOOSENESS / 8 * slope) ** 2
        distance = cv2.GaussianBlur((difference**2).sum(2) / variance, (0, 0), 0.7)
        return Comparison(distance, cover_of(difference), known, crop)

    def learn_colours(self) -> Colours:
        """Count the colours of the character and of what is around it over the kept pictures.

        Where the background is not known, what counts as the character is first the whole box, then, in some rounds,
        what the colours so far say (expectation and maximisation).
        """
        views = [self.view(t, picture, box, away) for t, picture, box, away in self.sampled()]
        if not views:
            return Colours(np.ones(NUM_BINS), np.ones(NUM_BINS))
        colours = colours_of(views, np.full(NUM_BINS, UNSURE))
        for _ in range(ROUNDS):
            colours = colours_of(views, 1.0 / (1.0 + np.exp(-colours.odds)))
        return colours

    def view(
        self, t: int, picture: UInt8[np.ndarray, "h w 3"], box: Float[np.ndarray, "4"], away: Float[np.ndarray, "h w"]
    ) -> View:
        """Reduce a kept picture to what learning colours needs: its pixels near the box."""
        seen = self.compare(t, picture, self.video_from_small, away)
        near = away < 0.5
        weight = 1.0 / (1.0 + np.exp(-plate_odds(seen, clutter_of(seen, away, box))[near]))
        is_known = seen.known[near] > 0.5
        return View(colour_bins(seen.picture[..., ::-1])[near], weight, is_known, away[near])

    def completed(self, shot: int) -> Behind:
        """Guess the background where the box always stood, from pixels whose colour speaks against the character."""
        samples, behind = self.survey.samples[shot], self.behind[shot]
        visible = [
            (255 * ((away > GUARD) | (self.colours.log_odds(picture[..., ::-1]) < BACKGROUND_COLOUR))).astype(np.uint8)
            for _, picture, _, away in self.sampled(shot)
        ]
        maps = self.survey.plane_from_frame[list(samples)]
        guess = median_plate(list(samples.values()), visible, maps)
        enough = guess.count >= max(FULL_COUNT, LEAST_GUESSED * len(samples))
        share = GUESSED * (enough & (guess.spread <= MOST_SPREAD)).astype(np.float32)
        better = share > behind.known
        return Behind(
            np.where(better[..., None], guess.colour, behind.colour),
            np.where(better, guess.spread, behind.spread),
            np.maximum(share, behind.known),
        )

    def outside(self, t: int, survey: Survey) -> UInt8[np.ndarray, "h w"]:
        """Mark with 255 what is surely outside the character's box in kept picture t."""
        height, width = survey.samples[int(self.track.shot[t])][t].shape[:2]
        return np.asarray(255 - box_mask(self.track.boxes_video[t] * self.scale, (width, height), GUARD))

    @property
    def video_from_small(self) -> Float[np.ndarray, "2 3"]:
        """The map from the kept pictures to the video."""
        return affine.scale_and_shift(1.0 / self.scale, (0.0, 0.0))

    def sampled(
        self, only: int | None = None
    ) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "4"], Float[np.ndarray, "h w"]]]:
        """Yield the kept pictures of one shot, or all where the character is: row, picture, box, distance from it."""
        for shot, samples in self.survey.samples.items():
            for t, picture in samples.items():
                box = box_in_crop(self.track.boxes_video[t], self.video_from_small)
                if only == shot or (only is None and self.track.state[t] != "lost"):
                    yield t, picture, box, distance_from_box(box, picture.shape[:2])


def colours_of(views: list[View], unsure: Float[np.ndarray, " bins"]) -> Colours:
    """Count colours; ``unsure`` is each colour's probability of the character where the background is not known.

    A colour is the character's when most pictures show it there: the largest counts are left out, so that what comes
    near for a while does not lend it its colours.
    """
    inside, around = [], np.zeros(NUM_BINS)
    for view in views:
        weight = np.where(view.is_known, view.weight, unsure[view.bins])
        rest = np.where(view.away > SURELY_OUTSIDE, 1.0, 1.0 - weight)
        inside.append(normalised(np.bincount(view.bins, weight * (view.away <= 0.0), NUM_BINS)))
        around += np.bincount(view.bins, rest, NUM_BINS)
    kept = max(1, round((1.0 - LEFT_OUT) * len(inside)))
    return Colours(np.sort(np.array(inside), 0)[:kept].mean(0), around)


def known_share(plate: Plate) -> Float[np.ndarray, "h w"]:
    """Say how far each plate pixel is known, 0..1."""
    count = plate.count.astype(np.float32)
    share = np.clip((count - LEAST_COUNT + 1) / (FULL_COUNT - LEAST_COUNT + 1), 0.0, 1.0)
    known: np.ndarray = np.where(plate.spread <= MOST_SPREAD, share, 0.0).astype(np.float32)
    return known


def noise_of(difference: Float[np.ndarray, "H W 3"], background: Bool[np.ndarray, "H W"]) -> float:
    """Measure how much background differs from the plate in this crop."""
    if background.sum() < 100:
        return 2.0 * LEAST_NOISE
    return max(LEAST_NOISE, 1.48 * float(np.median(difference[background][::3])))


def clutter_of(
    seen: Comparison, away: Float[np.ndarray, "H W"], box: Float[np.ndarray, "4"]
) -> Float[np.ndarray, "H W"]:
    """Measure how common differences are around the box, where the character hardly is, and nearer to some places."""
    small = (max(seen.known.shape[1] // 4, 1), max(seen.known.shape[0] // 4, 1))
    around = ((away > 0.08) & (seen.known > 0.5)).astype(np.float32)
    weight = cv2.resize(around, small, interpolation=cv2.INTER_AREA)
    differs = cv2.resize(around * (seen.distance > TURNING_POINT), small, interpolation=cv2.INTER_AREA)
    # The share over the whole ring counts a little everywhere: it stands in where the neighbourhood holds none of it.
    overall = float(differs.sum() / weight.sum()) if weight.sum() > 3 else 0.1
    deviation = max(CLUTTER_REACH * float(box[2:].max()) / 4.0, 0.5)
    near = cv2.GaussianBlur(differs, (0, 0), deviation) + 0.02 * overall
    local = near / (cv2.GaussianBlur(weight, (0, 0), deviation) + 0.02)
    size = seen.known.shape[1], seen.known.shape[0]
    clutter: np.ndarray = cv2.resize(np.clip(local, LEAST_CLUTTER, MOST_CLUTTER), size)
    return clutter


def plate_odds(seen: Comparison, clutter: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "H W"]:
    """Turn differences into log-odds, between those of "same" and "differs"."""
    same = np.log(CAMOUFLAGED / (1.0 - clutter))
    differs = np.log(DIFFERING / clutter)
    turn = 1.0 / (1.0 + np.exp(-(seen.distance - TURNING_POINT).clip(-60, 60) / TURNING_WIDTH))
    turn = np.where(
        at_rim(turn > 0.5), turn * np.clip((seen.cover - LEAST_COVER) / (1 - 2 * LEAST_COVER), 0.0, 1.0), turn
    )
    odds: np.ndarray = (seen.known * (same + (differs - same) * turn)).astype(np.float32)
    return odds


def cover_of(difference: Float[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W"]:
    """Compare each pixel's difference with the largest within two pixels."""
    size = np.sqrt((difference**2).sum(2))
    largest = cv2.dilate(cv2.GaussianBlur(size, (0, 0), 0.6), np.ones((5, 5), np.uint8))
    cover: np.ndarray = size / np.maximum(largest, 1.0)
    return cover


def at_rim(differs: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """Mark pixels that lie within two pixels of background; pinholes are no background."""
    closed = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    rim: np.ndarray = cv2.erode(closed, np.ones((5, 5), np.uint8)) == 0
    return rim


def place_odds(away: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "H W"]:
    """Turn the distance from the box into log-odds."""
    share = np.clip(away / FAR, 0.0, 1.0)
    odds: np.ndarray = PLACE_INSIDE + (PLACE_OUTSIDE - PLACE_INSIDE) * share
    return odds


def smoothed(odds: Float[np.ndarray, "H W"], crop: UInt8[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W"]:
    """Smooth log-odds inside areas of one colour; edges of the picture stay edges."""
    guide = cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255.0
    result: np.ndarray = cv2.ximgproc.guidedFilter(guide, odds.astype(np.float32), GUIDE_RADIUS, GUIDE_EDGE)
    return result


def box_in_crop(box_video: Float[np.ndarray, "4"], video_from_crop: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "4"]:
    """Take a box from video to crop pixels; the map is pure scale and shift."""
    scale = video_from_crop[0, 0]
    return np.concatenate([(box_video[:2] - video_from_crop[:, 2]) / scale, box_video[2:] / scale])


def distance_from_box(box: Float[np.ndarray, "4"], shape: tuple[int, ...]) -> Float[np.ndarray, "H W"]:
    """Return each pixel centre's distance from the box, in units of its larger side; 0 inside."""
    x, y = np.arange(shape[1], dtype=np.float32) + 0.5, np.arange(shape[0], dtype=np.float32) + 0.5
    beyond_x = np.maximum(np.maximum(box[0] - x, x - box[0] - box[2]), 0.0)
    beyond_y = np.maximum(np.maximum(box[1] - y, y - box[1] - box[3]), 0.0)
    distance: np.ndarray = np.hypot(beyond_x[None], beyond_y[:, None]) / max(float(box[2:].max()), 1.0)
    return distance.astype(np.float32)
