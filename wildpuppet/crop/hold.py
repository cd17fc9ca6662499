"""Windows that go with a held drawing: while a drawing is held, the character stays where it is in the crop, exactly.

Cartoons show a drawing for two or three frames while the camera, or the drawing as a whole, goes on moving. In such
frames the character's features agree on one shift and zoom; the window takes it over, so that the frames' crops show
the same drawing at the same place and one solution serves them all. Whether it is the same drawing is for
``video/held.py`` to say.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.crop.window import Windows
from wildpuppet.geometry import affine
from wildpuppet.track.camera import IDENTITY, common_shift, zoom_between

NUM_FEATURES = 120
LEAST_FEATURES = 10
# A feature that moves as the background does, to so many pixels, may be background that shows in the box.
BACKGROUND_PIXELS = 0.35
# A feature follows the character's motion when it is this close to it; so large a share must, or the window goes its
# own way.
FOLLOWS_PIXELS, LEAST_SHARE = 0.6, 0.5
# Rounds of fitting a motion: each fits the features that are this close to the round before.
FIT_PIXELS = (2.0, 1.2, 0.8, 0.6, 0.6)
# A window that goes along stays this close to where it was meant to be, as a share of its larger side.
FARTHEST = 0.12
# A motion that moves no corner of the box by more than this is none.
STILL_PIXELS = 0.12


@dataclass(frozen=True, eq=False)
class Step:
    """Features of the character's box in one frame and where they are in the next; pixels of the small pictures."""

    before: Float[np.ndarray, "n 2"]
    after: Float[np.ndarray, "n 2"]
    box: Float[np.ndarray, "4"]


class Steps:
    """Follows features from frame to frame; ``look`` is called with every small picture in order."""

    def __init__(self, shot: Int[np.ndarray, " T"]) -> None:
        self.shot = shot
        self.steps: dict[int, Step] = {}
        self.previous: UInt8[np.ndarray, "h w"] | None = None
        self.features: Float[np.ndarray, "n 1 2"] | None = None
        self.box = np.zeros(4)

    def look(self, t: int, picture: UInt8[np.ndarray, "h w 3"], box: Float[np.ndarray, "4"]) -> None:
        """Follow the last picture's features into picture t, and find features in its box."""
        gray: UInt8[np.ndarray, "h w"] = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        if self.previous is not None and self.features is not None and self.shot[t] == self.shot[t - 1]:
            # The box's own motion is where the search begins: a fast pan moves the character far.
            guess = (self.features - self.box[:2]) * (box[2:] / self.box[2:]) + box[:2]
            after, found, _ = cv2.calcOpticalFlowPyrLK(
                self.previous,
                gray,
                self.features,
                guess.astype(np.float32),
                winSize=(11, 11),
                maxLevel=2,
                flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            )
            kept = found.ravel() > 0
            self.steps[t] = Step(self.features[kept, 0] + 0.5, after[kept, 0] + 0.5, self.box)
        mask = np.zeros(gray.shape, np.uint8)
        left, top, right, bottom = np.round([box[0], box[1], box[0] + box[2], box[1] + box[3]]).astype(int)
        mask[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = 255
        apart = max(3.0, 0.03 * float(box[2:].max()))
        self.features = cv2.goodFeaturesToTrack(gray, NUM_FEATURES, 0.005, apart, mask=mask)
        self.previous, self.box = gray, box


def is_near(first: Float[np.ndarray, "2 3"], second: Float[np.ndarray, "2 3"], size: tuple[int, int]) -> bool:
    """Say whether two windows lie about at the same place."""
    corners = np.array([[0.0, 0.0], [float(size[0]), float(size[1])]])
    apart = np.abs(affine.apply(first, corners) - affine.apply(second, corners)).max()
    return bool(apart < FARTHEST * second[0, 0] * max(size))


def character_motion(step: Step, background: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"] | None:
    """Return the one shift and zoom that the character's features agree on, None where they do not.

    ``background`` is the camera's motion over the same step. Features that go with it are left out, unless the
    character does too.
    """
    before, after = step.before.astype(np.float64), step.after.astype(np.float64)
    own = ~close(background, before, after, BACKGROUND_PIXELS)
    if own.sum() < max(LEAST_FEATURES, 0.15 * len(own)):
        if len(own) < LEAST_FEATURES:
            return None
        motion, chosen = background, np.ones(len(own), bool)
    else:
        motion, chosen = shift_and_zoom(before[own], after[own]), own
    if close(motion, before[chosen], after[chosen], FOLLOWS_PIXELS).mean() < LEAST_SHARE:
        return None
    x, y, w, h = step.box
    corners = np.array([[x, y], [x + w, y], [x, y + h], [x + w, y + h]])
    still = np.abs(affine.apply(motion, corners) - corners).max() < STILL_PIXELS
    return IDENTITY.copy() if still else motion


def shift_and_zoom(before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 3"]:
    """Fit one shift and zoom to what most points do: from the commonest shift, in rounds over what agrees."""
    motion, _ = common_shift(before, after)
    for tolerance in FIT_PIXELS:
        agrees = close(motion, before, after, tolerance)
        if agrees.sum() < LEAST_FEATURES:
            break
        motion = zoom_between(before[agrees], after[agrees])
    return motion


def close(
    motion: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"], pixels: float
) -> Bool[np.ndarray, " n"]:
    """Mark the points that a motion explains to so many pixels."""
    return np.asarray(((affine.apply(motion, before) - after) ** 2).sum(1) < pixels**2)


def go_along(
    windows: Windows, steps: Steps, plane_from_frame: Float[np.ndarray, "T 2 3"], small_per_video: float
) -> Windows:
    """Let windows go along with the character over the steps in which it moves as a whole."""
    maps = windows.video_from_crop.copy()
    small_from_video = affine.scale_and_shift(small_per_video, (0.0, 0.0))
    for t, step in sorted(steps.steps.items()):
        background = affine.compose(affine.invert(plane_from_frame[t]), plane_from_frame[t - 1])
        motion = character_motion(step, background)
        if motion is None:
            continue
        video_motion = affine.compose(affine.invert(small_from_video), affine.compose(motion, small_from_video))
        along = affine.compose(video_motion, maps[t - 1])
        if is_near(along, windows.video_from_crop[t], windows.size):
            maps[t] = along
    return Windows(windows.size, maps)
