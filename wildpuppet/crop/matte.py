"""A soft matte for each crop: how surely each pixel is the character, as log-odds of three witnesses.

- The background plate: a pixel that looks as the plate does is background, one that differs is foreground. How much a
  difference says is measured in each crop: where things other than the character move around its box, differences are
  common there too and say little.
- Colour: how much likelier the colour is on the character than around it, learnt over the whole clip.
- Place: inside the box, a little; far outside, against.

Where no plate is known (the box always stood there, the camera's motion could not be found) colour and place remain,
which never make a matte sure. 128 is even odds.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.crop.plate import learn_plates, plate_scale
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.track.colours import NUM_BINS, Colours, counted
from wildpuppet.track.plate import Plate
from wildpuppet.track.survey import Survey
from wildpuppet.types import Clip, Track

# Plate pixels count from so many pictures on, fully from FULL_COUNT, and not where the pictures differ by more.
LEAST_COUNT, FULL_COUNT, MOST_SPREAD = 2, 6, 24
# Misregistration, in pixels, that a difference at an edge of the background may be due to.
LOOSENESS = 0.7
LEAST_NOISE = 2.5
# Share of the character's pixels that look as the background behind them, and that differ clearly.
CAMOUFLAGED, DIFFERING = 0.07, 0.9
# Differences around the box are at least this common.
LEAST_CLUTTER = 0.004
# Squared difference, in units of noise, at which a pixel changes from "same" to "differs", and the width of the change.
TURNING_POINT, TURNING_WIDTH = 16.0, 5.0
# Log-odds of place inside the box, and far outside it, reached at FAR of its larger side.
PLACE_INSIDE, PLACE_OUTSIDE, FAR = 0.4, -2.5, 0.25
# Weight of the colours' log-odds, and the most that they can say.
COLOUR_WEIGHT, MOST_COLOUR = 0.8, 2.2
# Learning colours: weight of pixels of the box whose background is not known.
UNSURE = 0.4
# Edge-preserving smoothing: radius in crop pixels and the change of grey (0..1), squared, that counts as an edge.
GUIDE_RADIUS, GUIDE_EDGE = 3, 4e-4


@dataclass(frozen=True, eq=False)
class Comparison:
    """What the plate says about a crop: squared difference in units of noise, and how far it is known (0..1)."""

    distance: Float[np.ndarray, "H W"]
    known: Float[np.ndarray, "H W"]


class Matter:
    """Makes mattes; ``scale`` is the plates' pixels per video pixel."""

    def __init__(self, track: Track, survey: Survey, scale: float) -> None:
        self.track, self.survey, self.scale = track, survey, scale
        self.known = {shot: known_share(plate) for shot, plate in survey.plates.items()}
        self.colours = self.learn_colours()

    def matte(
        self, t: int, crop: UInt8[np.ndarray, "H W 3"], video_from_crop: Float[np.ndarray, "2 3"]
    ) -> UInt8[np.ndarray, "H W"]:
        """Return 255 surely the character, 0 surely not, 128 unknown."""
        box = box_in_crop(self.track.boxes_video[t], video_from_crop)
        away = distance_from_box(box, crop.shape[:2])
        seen = self.compare(t, crop, video_from_crop)
        clutter = clutter_of(seen, away)
        odds = plate_odds(seen, clutter)
        odds += np.clip(COLOUR_WEIGHT * self.colours.log_odds(crop[..., ::-1]), -MOST_COLOUR, MOST_COLOUR)
        odds += place_odds(away)
        smooth = smoothed(odds, crop)
        return np.round(255.0 / (1.0 + np.exp(-smooth))).astype(np.uint8)

    def compare(
        self, t: int, crop: UInt8[np.ndarray, "H W 3"], video_from_crop: Float[np.ndarray, "2 3"]
    ) -> Comparison:
        """Compare a crop with its shot's plate."""
        shot = int(self.track.shot[t])
        plate = self.survey.plates[shot]
        small_from_crop = self.scale * video_from_crop
        plate_from_small = affine.compose(plate.plate_from_plane, self.survey.plane_from_frame[t])
        matrix = affine.for_opencv(affine.compose(plate_from_small, small_from_crop))
        size = crop.shape[1], crop.shape[0]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        behind = cv2.warpAffine(plate.colour, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        spread = cv2.warpAffine(plate.spread, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        known = cv2.warpAffine(self.known[shot], matrix, size, flags=flags)
        difference = cv2.absdiff(crop, behind).astype(np.float32)
        gray = cv2.cvtColor(behind, cv2.COLOR_RGB2GRAY)
        slope = np.abs(cv2.Sobel(gray, cv2.CV_32F, 1, 0)) + np.abs(cv2.Sobel(gray, cv2.CV_32F, 0, 1))
        away = distance_from_box(box_in_crop(self.track.boxes_video[t], video_from_crop), crop.shape[:2])
        noise = noise_of(difference, (known > 0.99) & (away > 0.03))
        variance = noise**2 + spread.astype(np.float32) ** 2 + (LOOSENESS / 8 * slope) ** 2
        distance = cv2.GaussianBlur((difference**2).sum(2) / variance, (0, 0), 0.7)
        return Comparison(distance, known)

    def learn_colours(self) -> Colours:
        """Count the colours of the character and of what is around it over all kept pictures."""
        inside, around = np.zeros(NUM_BINS), np.zeros(NUM_BINS)
        video_from_small = affine.scale_and_shift(1.0 / self.scale, (0.0, 0.0))
        for samples in self.survey.samples.values():
            for t, picture in samples.items():
                if self.track.state[t] == "lost":
                    continue
                away = distance_from_box(box_in_crop(self.track.boxes_video[t], video_from_small), picture.shape[:2])
                seen = self.compare(t, picture, video_from_small)
                odds = plate_odds(seen, clutter_of(seen, away))
                weight = np.where(seen.known > 0.5, 1.0 / (1.0 + np.exp(-odds)), UNSURE)
                inside += counted(picture[..., ::-1], weight * (away <= 0.0))
                around += counted(picture[..., ::-1], (1.0 - weight) * (away < 0.5) * ((away > 0.0) | (seen.known > 0.5)))
        return Colours(inside, around)


def prepare_matter(clip: Clip, track: Track, crop_from_video: float, machine: Machine) -> Matter:
    """Look at the clip once and learn what the mattes need."""
    scale = plate_scale(clip, crop_from_video)
    return Matter(track, learn_plates(clip, track, scale, machine), scale)


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


def clutter_of(seen: Comparison, away: Float[np.ndarray, "H W"]) -> float:
    """Measure how common differences are around the box, where the character hardly is."""
    around = (away > 0.08) & (away < 0.5) & (seen.known > 0.5)
    if around.sum() < 50:
        return 0.1
    return max(LEAST_CLUTTER, float((seen.distance[around] > TURNING_POINT).mean()))


def plate_odds(seen: Comparison, clutter: float) -> Float[np.ndarray, "H W"]:
    """Turn differences into log-odds, between those of "same" and "differs"."""
    same = np.log(CAMOUFLAGED / (1.0 - clutter))
    differs = max(np.log(DIFFERING / clutter), 0.0)
    turn = 1.0 / (1.0 + np.exp(-(seen.distance - TURNING_POINT).clip(-60, 60) / TURNING_WIDTH))
    odds: np.ndarray = (seen.known * (same + (differs - same) * turn)).astype(np.float32)
    return odds


def place_odds(away: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "H W"]:
    """Turn the distance from the box into log-odds."""
    share = np.clip(away / FAR, 0.0, 1.0)
    odds: np.ndarray = PLACE_INSIDE + (PLACE_OUTSIDE - PLACE_INSIDE) * share
    return odds


def smoothed(odds: Float[np.ndarray, "H W"], crop: UInt8[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W"]:
    """Smooth log-odds inside areas of one colour; edges of the picture stay edges."""
    guide = crop.astype(np.float32) / 255.0
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
