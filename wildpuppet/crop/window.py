"""From boxes to windows: where each frame's crop lies in the video.

All windows of a run have one size in crop pixels and are pure scale and shift, so a crop is a steady camera on the
character. The path of the window is the taut string through a tube around the path of the box: it stands perfectly
still while the box stays within the slack, and otherwise moves as little and as evenly as possible. A still window
under a still camera shows a held drawing as an unchanged crop. The same is done with the logarithm of the scale.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.settings import CropSettings
from wildpuppet.track.smooth import regress, sides_to_centres

# Share of the margin that the box may wander before the window follows.
WANDER = 0.4
# The window's scale follows when the character's size leaves a band of this factor up or down.
ZOOM_BAND = 1.15
# Standard deviation, in frames, of the smoothing of the size: poses change the box too, and are not a zoom.
ZOOM_FRAMES = 10.0


@dataclass(frozen=True, eq=False)
class Windows:
    """One window per frame: ``size`` (w, h) in crop pixels and the maps to video pixels."""

    size: tuple[int, int]
    video_from_crop: Float[np.ndarray, "T 2 3"]


def windows_of(
    boxes_video: Float[np.ndarray, "T 4"], shot: Int[np.ndarray, " T"], reference: int, settings: CropSettings
) -> Windows:
    """Lay windows around the boxes.

    In frame ``reference`` the larger side of the box becomes ``settings.box_pixels`` crop pixels, or stays as it is
    where the video is coarser than that: nothing is magnified there.
    """
    if len(boxes_video) == 0:
        raise ValueError("windows_of: expected at least one box, found none")
    values = sides_to_centres(boxes_video)
    zoom = zoom_path(values[:, 2:].mean(1), shot, reference)
    side = float(boxes_video[reference, 2:].max())
    scale = min(1.0, settings.box_pixels / side)
    inner = np.maximum(np.percentile(boxes_video[:, 2:] / zoom[:, None], 98, axis=0), boxes_video[reference, 2:])
    margin = settings.margin * float(inner.max())
    size = even((inner + 2 * margin) * scale)
    slack = np.maximum(WANDER * margin, 0.0) * zoom
    centres = np.stack([string_by_shot(values[:, axis], slack, shot) for axis in (0, 1)], 1)
    video_per_crop = zoom / scale
    # Whole video pixels: at scale 1 a crop is then an exact copy, and a moving window does not shimmer.
    corner = np.round(centres - 0.5 * np.array(size) * video_per_crop[:, None])
    linear = video_per_crop[:, None, None] * np.eye(2)
    return Windows(size, np.concatenate([linear, corner[..., None]], 2))


def zoom_path(
    log_side: Float[np.ndarray, " T"], shot: Int[np.ndarray, " T"], reference: int
) -> Float[np.ndarray, " T"]:
    """Return the window's size relative to that at ``reference``: 1 unless the character's size changes markedly."""
    smoothed = np.empty(len(shot))
    for number in np.unique(shot):
        chosen = shot == number
        smoothed[chosen] = regress(log_side[chosen, None], np.ones(int(chosen.sum())), ZOOM_FRAMES)[:, 0]
    path = string_by_shot(smoothed, np.full(len(shot), np.log(ZOOM_BAND)), shot)
    zoom: np.ndarray = np.exp(path - path[reference])
    return zoom


def string_by_shot(
    values: Float[np.ndarray, " T"], slack: Float[np.ndarray, " T"], shot: Int[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """Pull a string taut inside values +- slack, shot by shot."""
    result = np.empty(len(values))
    for number in np.unique(shot):
        chosen = shot == number
        result[chosen] = taut_string(values[chosen] - slack[chosen], values[chosen] + slack[chosen])
    return result


def taut_string(low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the shortest path with low <= path <= high and free ends; constant where a constant fits.

    Of all constants that fit, the one closest to the tube's mean is taken. Walks from bend to bend: a segment is
    extended until no straight line fits, then it bends where the tube touched it.
    """
    count = len(low)
    path = np.empty(count)
    at, value = first_bend(low, high)
    path[: at + 1] = value
    while at < count - 1:
        bend, slope = next_bend(low, high, at, value)
        steps = np.arange(1, bend - at + 1)
        path[at + 1 : bend + 1] = value + slope * steps
        at, value = bend, float(path[bend])
    return path


def first_bend(low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]) -> tuple[int, float]:
    """Find how far a level start reaches: the index of its last touching and its value."""
    highest, lowest = np.maximum.accumulate(low), np.minimum.accumulate(high)
    crossing = np.flatnonzero(highest > lowest)
    if len(crossing) == 0:
        return len(low) - 1, float(np.clip((low + high).mean() / 2, highest[-1], lowest[-1]))
    stop = int(crossing[0])
    goes_up = low[stop] > lowest[stop - 1]
    value = float(lowest[stop - 1] if goes_up else highest[stop - 1])
    touched = np.flatnonzero((high if goes_up else low)[:stop] == value)
    return int(touched[-1]), value


def next_bend(low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"], at: int, value: float) -> tuple[int, float]:
    """From (at, value), find the straight line's next touching point and its slope."""
    steps = np.arange(1, len(low) - at)
    floor, ceiling = (low[at + 1 :] - value) / steps, (high[at + 1 :] - value) / steps
    highest, lowest = np.maximum.accumulate(floor), np.minimum.accumulate(ceiling)
    crossing = np.flatnonzero(highest > lowest)
    if len(crossing) == 0:
        slope = float(np.clip(0.0, highest[-1], lowest[-1]))
        if slope == 0.0:
            return len(low) - 1, 0.0
        touched = np.flatnonzero((floor if slope > 0 else ceiling) == slope)
        return at + 1 + int(touched[-1]), slope
    stop = int(crossing[0])
    goes_up = floor[stop] > lowest[stop - 1]
    slope = float(lowest[stop - 1] if goes_up else highest[stop - 1])
    touched = np.flatnonzero((ceiling if goes_up else floor)[:stop] == slope)
    return at + 1 + int(touched[-1]), slope


def even(size: Float[np.ndarray, "2"]) -> tuple[int, int]:
    """Round up to even whole numbers (video codecs want them)."""
    whole = 2 * np.ceil(size / 2).astype(np.int64)
    return int(whole[0]), int(whole[1])
