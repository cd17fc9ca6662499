"""The camera's motion: a similarity per frame that most of the background's features agree on.

Each frame is registered to an *anchor* picture rather than to the frame before, so errors add up only where the anchor
changes (when too few of its features are left). Corner-origin pixels of the small, unpadded pictures.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.geometry import affine

# One feature is taken from each cell of a grid of about so many squares: otherwise a drawn character before a painted,
# soft background gets them all.
NUM_CELLS = 220
LEAST_CELL = 12
# So many features propose a shift that the others vote on.
NUM_PROPOSALS = 64
# Corners weaker than this (smaller eigenvalue of the gradients) are flat.
LEAST_CORNER = 2e-5
# Features further than this from the common motion, in pixels, are not background.
INLIER_PIXELS = 1.0
LEAST_INLIERS = 12
LEAST_INLIER_SHARE = 0.3
# A new anchor is taken when less than this share of the features that agreed at first still do.
LEAST_LEFT = 0.6
# The simplest motion (shift; zoom; zoom and turn) that at least this share of the best one's features agree with.
SIMPLE_ENOUGH = 0.9
# A motion that moves no corner of the picture by more than this is measurement noise: the camera stands.
STILL_PIXELS = 0.15

IDENTITY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class Camera:
    """Follows the camera through one shot; ``step`` is called with each picture in order."""

    def __init__(self) -> None:
        self.anchor: UInt8[np.ndarray, "h w"] | None = None
        self.previous: UInt8[np.ndarray, "h w"] | None = None
        self.plane_from_anchor = IDENTITY.copy()
        self.agreed = 0.0
        self.previous_from_anchor = IDENTITY.copy()

    def step(
        self, gray: UInt8[np.ndarray, "h w"], background: UInt8[np.ndarray, "h w"] | None
    ) -> Float[np.ndarray, "2 3"]:
        """Return plane_from_frame for the next picture; the plane is the first picture's.

        ``background`` is non-zero where features of this picture may be taken later, None for everywhere. Where
        nothing can be registered the camera is taken to stand.
        """
        if self.anchor is None:
            self.take_anchor(gray, background, IDENTITY)
            return self.plane_from_anchor
        motion, left = register(self.anchor, gray, self.features, self.previous_from_anchor)
        if motion is None:
            motion = self.step_from_previous(gray)
            left = 0.0
        self.previous, self.previous_from_anchor = gray, motion
        plane_from_frame = affine.compose(self.plane_from_anchor, affine.invert(motion))
        self.agreed = max(self.agreed, left)
        if left <= LEAST_LEFT * self.agreed:
            self.take_anchor(gray, background, plane_from_frame)
        return plane_from_frame

    def step_from_previous(self, gray: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "2 3"]:
        """Register to the frame before, when the anchor is out of reach; returns current_from_anchor."""
        assert self.previous is not None
        motion, _ = register(self.previous, gray, features_of(self.previous, None), IDENTITY)
        return self.previous_from_anchor if motion is None else affine.compose(motion, self.previous_from_anchor)

    def take_anchor(
        self,
        gray: UInt8[np.ndarray, "h w"],
        background: UInt8[np.ndarray, "h w"] | None,
        plane_from_frame: Float[np.ndarray, "2 3"],
    ) -> None:
        """Register the next pictures to this one."""
        self.anchor = self.previous = gray
        self.agreed = 0.0
        self.features = features_of(gray, background)
        self.plane_from_anchor, self.previous_from_anchor = plane_from_frame.copy(), IDENTITY.copy()


def features_of(
    gray: UInt8[np.ndarray, "h w"], background: UInt8[np.ndarray, "h w"] | None
) -> Float[np.ndarray, "n 2"]:
    """Find the strongest corner of each cell of a grid."""
    cell = max(LEAST_CELL, int(np.sqrt(gray.size / NUM_CELLS)))
    strength = cv2.cornerMinEigenVal(gray, 3)
    if background is not None:
        strength[background == 0] = 0.0
    # Near the edge a corner leaves the picture at once and its window is cut.
    border = cell // 2
    rows, columns = (gray.shape[0] - 2 * border) // cell, (gray.shape[1] - 2 * border) // cell
    inner = strength[border : border + rows * cell, border : border + columns * cell]
    cells = inner.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(rows, columns, -1)
    y, x = np.divmod(cells.argmax(2), cell)
    points = np.stack([x + cell * np.arange(columns), y + cell * np.arange(rows)[:, None]], -1) + border + 0.5
    chosen: np.ndarray = points[cells.max(2) > LEAST_CORNER]
    return chosen


def register(
    first: UInt8[np.ndarray, "h w"],
    second: UInt8[np.ndarray, "h w"],
    features: Float[np.ndarray, "n 2"],
    guess: Float[np.ndarray, "2 3"],
) -> tuple[Float[np.ndarray, "2 3"] | None, float]:
    """Return second_from_first and the share of features that agree; (None, 0) where too few do."""
    if len(features) < LEAST_INLIERS:
        return None, 0.0
    before = (features - 0.5).astype(np.float32, order="C").reshape(-1, 1, 2)
    start = (affine.apply(guess, features) - 0.5).astype(np.float32, order="C").reshape(-1, 1, 2)
    after, found, _ = cv2.calcOpticalFlowPyrLK(
        first, second, before, start, winSize=(15, 15), maxLevel=2, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    kept = found.ravel() > 0
    if kept.sum() < LEAST_INLIERS:
        return None, 0.0
    motion, agree = common_motion(before[kept][:, 0] + 0.5, after[kept][:, 0] + 0.5)
    share = float(agree) / len(features)
    if agree < LEAST_INLIERS or share < LEAST_INLIER_SHARE * float(kept.mean()):
        return None, 0.0
    return (IDENTITY.copy() if is_still(motion, second.shape) else motion), share


def common_motion(
    before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "2 3"], int]:
    """Find the simplest motion that about as many points agree with as with any; returns it and their number."""
    shift, num_shift = common_shift(before, after)
    turned, inliers = cv2.estimateAffinePartial2D(before, after, ransacReprojThreshold=INLIER_PIXELS)
    num_turned = 0 if turned is None else int(inliers.sum())
    if num_shift >= SIMPLE_ENOUGH * num_turned:
        return shift, num_shift
    chosen = inliers.ravel() > 0
    zoom = zoom_between(before[chosen], after[chosen])
    num_zoom = int(agreeing(zoom, before, after).sum())
    if num_zoom >= SIMPLE_ENOUGH * num_turned:
        return zoom, num_zoom
    return turned.astype(np.float64), num_turned


def common_shift(
    before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "2 3"], int]:
    """Find the shift that most points agree with."""
    moves = (after - before).astype(np.float64)
    proposed = moves[:: len(moves) // NUM_PROPOSALS + 1]
    close = ((proposed[:, None] - moves[None]) ** 2).sum(2) < INLIER_PIXELS**2
    mean = moves[close[close.sum(1).argmax()]].mean(0)
    mean = moves[((moves - mean) ** 2).sum(1) < INLIER_PIXELS**2].mean(0)
    motion = affine.scale_and_shift(1.0, (float(mean[0]), float(mean[1])))
    return motion, int(agreeing(motion, before, after).sum())


def zoom_between(before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 3"]:
    """Fit scale and shift in the least-squares sense."""
    first, second = before.mean(0), after.mean(0)
    scale = float(((before - first) * (after - second)).sum() / max(float(((before - first) ** 2).sum()), 1e-9))
    shift = second - scale * first
    return affine.scale_and_shift(scale, (float(shift[0]), float(shift[1])))


def agreeing(
    motion: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, " n"]:
    """Mark the points that a motion explains."""
    marked: np.ndarray = ((affine.apply(motion, before) - after) ** 2).sum(1) < INLIER_PIXELS**2
    return marked


def is_still(motion: Float[np.ndarray, "2 3"], shape: tuple[int, ...]) -> bool:
    """Say whether a motion moves no corner of the picture noticeably."""
    height, width = shape[:2]
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
    return float(np.abs(affine.apply(motion, corners) - corners).max()) < STILL_PIXELS
