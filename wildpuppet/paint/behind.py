"""The picture without the character: the frame itself around it, the background plate where it stands."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.crop.light import light_between
from wildpuppet.crop.matte import Matter
from wildpuppet.crop.plate import learn_plates, plate_scale
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.paint.layers import Drawn
from wildpuppet.recut import track_of
from wildpuppet.runs import RunFolder
from wildpuppet.types import Clip, Track

KNOWN = 0.3
"""How far the plate must be known (0..1) to be shown; elsewhere neighbours are filled in."""
AROUND = 0.02
"""How far beyond the puppet the character may reach, as a share of its larger side."""
LEAST_AROUND = 4
FILL_SIDE = 640
"""Pictures are filled in at most at this size: what is unknown is smooth anyway."""
PATIENCE = 5.0


class Paper:
    """White paper, behind drawings."""

    def picture(self, t: int, picture: UInt8[np.ndarray, "H W 3"], drawn: Drawn | None) -> UInt8[np.ndarray, "H W 3"]:
        """Take everything off the paper."""
        return np.full_like(picture, 255)


class Behind:
    """Gives frames without the character; learning the plates costs one pass over the clip."""

    def __init__(self, clip: Clip, track: Track, crop_from_video: float, machine: Machine) -> None:
        scale = plate_scale(clip, track, crop_from_video)
        survey, _ = learn_plates(clip, track, scale, machine)
        self._matter, self._shot = Matter(track, survey, scale), track.shot

    def picture(self, t: int, picture: UInt8[np.ndarray, "H W 3"], drawn: Drawn | None) -> UInt8[np.ndarray, "H W 3"]:
        """Take the character out of frame ``t`` of the run."""
        if drawn is None:
            return picture
        height, width = picture.shape[:2]
        hidden = np.zeros((height, width), np.uint8)
        hidden[drawn.window] = drawn.before[..., 3] > 0.02
        rows, columns = np.nonzero(hidden)
        if not len(rows):
            return picture
        by = max(LEAST_AROUND, round(AROUND * max(int(np.ptp(rows)), int(np.ptp(columns)))))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1, 2 * by + 1))
        grown = np.asarray(cv2.dilate(hidden, disc), np.uint8)
        colour, known = self._plate(t, picture, grown)
        return filled(picture, colour, known, grown)

    def _plate(
        self, t: int, picture: UInt8[np.ndarray, "H W 3"], hidden: UInt8[np.ndarray, "H W"]
    ) -> tuple[UInt8[np.ndarray, "H W 3"], Float[np.ndarray, "H W"]]:
        """Lay the shot's plate over the frame, in the frame's light."""
        matter, shot = self._matter, int(self._shot[t])
        plate, behind = matter.survey.plates[shot], matter.behind[shot]
        small_from_video = affine.scale_and_shift(matter.scale, (0.0, 0.0))
        plate_from_small = affine.compose(plate.plate_from_plane, matter.survey.plane_from_frame[t])
        matrix = affine.for_opencv(affine.compose(plate_from_small, small_from_video))
        size, flags = picture.shape[1::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        colour = cv2.warpAffine(behind.colour, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        known = cv2.warpAffine(behind.known, matrix, size, flags=flags)
        if shot in matter.changing_light:
            gain = light_between(picture, colour, (hidden == 0) & (known > 0.99))
            colour = np.clip(np.rint(colour * gain), 0, 255).astype(np.uint8)
        return colour, known


def background_of_run(run: RunFolder, place: Clip | Path) -> Paper | Behind:
    """Give what lies behind a run's character; ``place`` as ``recut.place_of_run`` finds it."""
    if not isinstance(place, Clip):
        return Paper()
    crops = run.crops
    crop_from_video = 1.0 / float(crops.video_from_crop[crops.reference or 0, 0, 0])
    return Behind(place, track_of(crops), crop_from_video, Machine())


def filled(
    picture: UInt8[np.ndarray, "H W 3"],
    colour: UInt8[np.ndarray, "H W 3"],
    known: Float[np.ndarray, "H W"],
    hidden: UInt8[np.ndarray, "H W"],
) -> UInt8[np.ndarray, "H W 3"]:
    """Show ``colour`` where something is hidden, with a soft rim; fill in what is not known of it from around."""
    shown = np.where((hidden > 0)[..., None], colour, picture)
    # the plate is black where it is not known, and that runs into its neighbours
    doubtful = cv2.dilate((known < KNOWN).astype(np.uint8), np.ones((3, 3), np.uint8))
    unknown = np.asarray((doubtful > 0) & (hidden > 0), np.uint8)
    if unknown.any():
        shown = _inpainted(shown, unknown)
    share = cv2.GaussianBlur(hidden.astype(np.float32), (0, 0), 1.2)[..., None]
    share = np.where(hidden[..., None] > 0, share, 0.0)
    mixed = share * shown + (1.0 - share) * picture
    return np.asarray(np.rint(mixed), np.uint8)


def _inpainted(picture: UInt8[np.ndarray, "H W 3"], unknown: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W 3"]:
    height, width = picture.shape[:2]
    scale = min(1.0, FILL_SIDE / max(height, width))
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    mask = (cv2.resize(unknown.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.0).astype(np.uint8)
    done = cv2.resize(cv2.inpaint(small, mask, PATIENCE, cv2.INPAINT_TELEA), (width, height))
    return np.where((unknown > 0)[..., None], done, picture)
