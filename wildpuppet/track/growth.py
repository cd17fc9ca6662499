"""How much the character grew between two pictures: the median change of the distances between its features."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.track.trackers import Box

NUM_FEATURES = 60
LEAST_FEATURES = 8
# A feature that does not come back to within so many pixels when it is followed backwards does not count.
RETURN_PIXELS = 0.5
# Two features closer than this share of the box's larger side say too little about size.
LEAST_APART = 0.2
# Growth from one frame to the next beyond this factor is not believed.
MOST_GROWTH = 1.06


def growth_between(previous: UInt8[np.ndarray, "h w"], current: UInt8[np.ndarray, "h w"], box: Box) -> float:
    """Return the factor by which what is inside ``box`` in the previous picture grew; 1 where that cannot be told."""
    height, width = previous.shape
    left, top = max(round(box[0]), 0), max(round(box[1]), 0)
    right, bottom = min(round(box[0] + box[2]), width), min(round(box[1] + box[3]), height)
    if right - left < 8 or bottom - top < 8:
        return 1.0
    inside = previous[top:bottom, left:right]
    features = cv2.goodFeaturesToTrack(inside, NUM_FEATURES, 0.01, max(3.0, 0.04 * max(box[2:])))
    if features is None or len(features) < LEAST_FEATURES:
        return 1.0
    before = features + np.array([left, top], np.float32)
    after, found, _ = cv2.calcOpticalFlowPyrLK(previous, current, before, before.copy(), winSize=(11, 11), maxLevel=2)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(current, previous, after, after.copy(), winSize=(11, 11), maxLevel=2)
    stays = np.linalg.norm(back - before, axis=2).ravel() < RETURN_PIXELS
    kept = (found.ravel() > 0) & (returned.ravel() > 0) & stays
    return median_growth(before[kept, 0], after[kept, 0], LEAST_APART * max(box[2:]))


def median_growth(before: Float[np.ndarray, "n 2"], after: Float[np.ndarray, "n 2"], least_apart: float) -> float:
    """Take the median ratio of distances over all pairs of points that were far enough apart."""
    if len(before) < LEAST_FEATURES:
        return 1.0
    first, second = np.triu_indices(len(before), 1)
    length = np.linalg.norm(before[first] - before[second], axis=1)
    apart = length > least_apart
    if apart.sum() < LEAST_FEATURES:
        return 1.0
    ratio = np.linalg.norm(after[first] - after[second], axis=1)[apart] / length[apart]
    return float(np.clip(np.median(ratio), 1.0 / MOST_GROWTH, MOST_GROWTH))
