"""Bridging short gaps and smoothing boxes over time.

Smoothing is a local straight-line fit with Gaussian weights (a local linear regression): it neither lags behind a
steady move nor pulls inwards at the ends, as a moving average does. Centres and the logarithms of the sides are
smoothed; frames of another shot or across a long gap do not count.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.types import TrackState

# A gap this long or shorter is interpolated and called bridged; about a third of a second.
LONGEST_BRIDGE = 8
# Unless less than this share of a box beside the gap was in the picture: then the character was out of it.
LEAST_IN_PICTURE = 0.8
# The user's box weighs this much more than a tracked one.
REFERENCE_WEIGHT = 30.0


def bridge(
    state: list[TrackState], shot: Int[np.ndarray, " T"], in_picture: Float[np.ndarray, " T"]
) -> list[TrackState]:
    """Call short lost gaps inside a shot, seen on both sides, bridged; ``in_picture`` is the share of each box."""
    result = list(state)
    seen = [t for t, value in enumerate(state) if value != "lost"]
    for before, after in pairwise(seen):
        is_short = 1 < after - before <= LONGEST_BRIDGE + 1 and shot[before] == shot[after]
        if is_short and min(in_picture[before], in_picture[after]) > LEAST_IN_PICTURE:
            result[before + 1 : after] = ["bridged"] * (after - before - 1)
            result[after] = "followed"
    return result


def share_in_picture(boxes: Float[np.ndarray, "T 4"], size: tuple[int, int]) -> Float[np.ndarray, " T"]:
    """How much of each box lies in a picture of this size, 0 to 1."""
    low, high = np.maximum(boxes[:, :2], 0.0), np.minimum(boxes[:, :2] + boxes[:, 2:], size)
    inside: np.ndarray = np.maximum(high - low, 0.0).prod(1) / np.maximum(boxes[:, 2:].prod(1), 1e-9)
    return inside


def fill(boxes: Float[np.ndarray, "T 4"], state: list[TrackState]) -> Float[np.ndarray, "T 4"]:
    """Interpolate boxes where the character was not seen; hold the nearest at the ends."""
    seen = np.array([value in ("followed", "found") for value in state])
    if seen.all() or not seen.any():
        return boxes
    times = np.arange(len(boxes))
    columns = [np.interp(times, times[seen], column[seen]) for column in sides_to_centres(boxes).T]
    return centres_to_sides(np.stack(columns, 1))


def smooth(
    boxes: Float[np.ndarray, "T 4"], run: Int[np.ndarray, " T"], deviation: float, reference: int
) -> Float[np.ndarray, "T 4"]:
    """Smooth each run of frames with equal ``run`` number; the box at ``reference`` stays exactly as it is."""
    if deviation <= 0:
        return boxes
    values = sides_to_centres(boxes)
    weight = np.ones(len(boxes))
    weight[reference] = REFERENCE_WEIGHT
    result = values.copy()
    for number in np.unique(run):
        chosen = run == number
        # Sizes change more slowly than places and are measured worse.
        result[chosen, :2] = regress(values[chosen, :2], weight[chosen], deviation / 2)
        result[chosen, 2:] = regress(values[chosen, 2:], weight[chosen], deviation)
    smoothed = centres_to_sides(result)
    smoothed[reference] = boxes[reference]
    return smoothed


def regress(
    values: Float[np.ndarray, "n k"], weight: Float[np.ndarray, " n"], deviation: float
) -> Float[np.ndarray, "n k"]:
    """Fit a weighted straight line around each row and take its value there."""
    reach = int(np.ceil(3 * deviation))
    result = np.empty_like(values)
    for t in range(len(values)):
        low, high = max(t - reach, 0), min(t + reach + 1, len(values))
        offset = np.arange(low, high) - t
        kernel = np.exp(-0.5 * (offset / deviation) ** 2) * weight[low:high]
        total, first, second = kernel.sum(), (kernel * offset).sum(), (kernel * offset**2).sum()
        spread = total * second - first**2
        level = kernel @ values[low:high]
        slope = (kernel * offset) @ values[low:high]
        result[t] = (second * level - first * slope) / spread if spread > 1e-9 * total**2 else level / total
    return result


def runs_of(state: list[TrackState], shot: Int[np.ndarray, " T"]) -> Int[np.ndarray, " T"]:
    """Number the stretches that are smoothed together: one shot, seen or not seen without a change."""
    lost = np.array([value == "lost" for value in state])
    change = np.r_[False, (np.diff(shot) != 0) | (np.diff(lost.astype(np.int64)) != 0)]
    return np.cumsum(change)


def sides_to_centres(boxes: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """Turn x, y, w, h into centre x, centre y, log w, log h."""
    return np.concatenate([boxes[:, :2] + boxes[:, 2:] / 2, np.log(np.maximum(boxes[:, 2:], 1e-3))], 1)


def centres_to_sides(values: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """Turn centre x, centre y, log w, log h into x, y, w, h."""
    sides = np.exp(values[:, 2:])
    return np.concatenate([values[:, :2] - sides / 2, sides], 1)
