"""Light that changes while the background stays: dusk, a fade, a flash.

Where the light of a shot changes, a plate that is the median over its pictures has no light at all, and everything
differs from it. Here each kept picture's light is measured against the plate, channel by channel, outside the
character's box; pictures are brought to one light and the plate is made anew of them.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.geometry import affine
from wildpuppet.track.plate import Plate, median_plate
from wildpuppet.track.survey import Survey

# Darker channels (0..255) say nothing about light, fewer pixels than this neither.
DARK, LEAST_PIXELS = 24, 200
MOST_GAIN = 3.0
# A shot's light changes when its darkest and its lightest picture are farther apart than this (log). Less is measured
# where old film flickers or a crowd moves behind the character, and the plate's spread bears with it.
LEAST_CHANGE = 0.2
# Rounds of measuring the light and making the plate.
ROUNDS = 2

Pictures = dict[int, UInt8[np.ndarray, "a b 3"]]
Visible = Callable[[int], UInt8[np.ndarray, "a b"]]


def in_one_light(survey: Survey, visible: Visible) -> tuple[Survey, frozenset[int]]:
    """Bring the kept pictures of shots whose light changes to one light; give the survey and those shots.

    ``visible(t)`` is 255 where picture t shows background. Shots in steady light stay as they are, bit by bit.
    """
    plates, samples, changing = dict(survey.plates), dict(survey.samples), set()
    for shot, plate in survey.plates.items():
        gains = lights_of(survey, survey.samples[shot], plate, visible)
        if np.ptp(np.log(gains), axis=0).max() < LEAST_CHANGE:
            continue
        changing.add(shot)
        for _ in range(ROUNDS):
            pictures = zip(survey.samples[shot].items(), gains, strict=True)
            samples[shot] = {t: without_light(picture, gain) for (t, picture), gain in pictures}
            masks = [visible(t) for t in samples[shot]]
            plates[shot] = median_plate(
                list(samples[shot].values()), masks, survey.plane_from_frame[list(samples[shot])]
            )
            gains = lights_of(survey, survey.samples[shot], plates[shot], visible)
    return replace(survey, plates=plates, samples=samples), frozenset(changing)


def lights_of(survey: Survey, pictures: Pictures, plate: Plate, visible: Visible) -> Float[np.ndarray, "n 3"]:
    """Measure each picture's light against a plate."""
    gains = []
    for t, picture in pictures.items():
        size = picture.shape[1], picture.shape[0]
        matrix = affine.for_opencv(affine.compose(plate.plate_from_plane, survey.plane_from_frame[t]))
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        colour = cv2.warpAffine(plate.colour, matrix, size, flags=flags)
        count = cv2.warpAffine(plate.count, matrix, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
        gains.append(light_between(picture, colour, (visible(t) > 0) & (count > 0)))
    return np.array(gains)


def light_between(
    picture: UInt8[np.ndarray, "a b 3"], plate: UInt8[np.ndarray, "a b 3"], background: Bool[np.ndarray, "a b"]
) -> Float[np.ndarray, "3"]:
    """Measure how many times lighter each channel of a picture is than the plate; 1 where little is seen."""
    gains = np.ones(3)
    for channel in range(3):
        behind = plate[..., channel]
        chosen = background & (behind > DARK)
        if chosen.sum() > LEAST_PIXELS:
            ratio = float(np.median(picture[..., channel][chosen] / behind[chosen].astype(np.float32)))
            gains[channel] = np.clip(ratio, 1.0 / MOST_GAIN, MOST_GAIN)
    return gains


def without_light(picture: UInt8[np.ndarray, "a b 3"], gain: Float[np.ndarray, "3"]) -> UInt8[np.ndarray, "a b 3"]:
    """Show a picture in the plate's light."""
    shown: np.ndarray = np.clip(np.rint(picture / gain.astype(np.float32)), 0, 255).astype(np.uint8)
    return shown
