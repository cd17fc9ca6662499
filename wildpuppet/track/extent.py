"""The character's box from a map of where it may be: connected pieces around the predicted box."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.track.scene import Region, inside_box
from wildpuppet.track.trackers import Box

# A piece counts when this share of it lies in the predicted box widened by NEAR of its larger side.
LEAST_OVERLAP, NEAR = 0.5, 0.08
# A piece whose colours have smaller mean log-odds is something else that moves.
LEAST_COLOUR = -0.4
# Pieces smaller than this share of the box are specks; this share of the mass is cut off at each side.
SPECK, TRIM = 0.006, 0.003
# A shift must gain this share of the box's area in weight; a shift by the whole box costs PULL_PENALTY of it.
LEAST_PULL, PULL_PENALTY = 0.04, 0.3
# Pieces of a whole picture count from this share of the character's box on; so many are proposed.
LEAST_PIECE, MOST_PIECES = 0.1, 4
# The filled share of the box must lie between these for a measurement to count.
LEAST_FILL, MOST_FILL = 0.12, 2.5


def measure(
    mask: Bool[np.ndarray, "a b"], colour: Float[np.ndarray, "a b"], region: Region, predicted: Box
) -> tuple[Box, tuple[bool, bool, bool, bool]] | None:
    """Return the box of the marked pieces near ``predicted`` and which sides (left, top, right, bottom) are free.

    A side is not free when the pieces run on to the edge of the region: something else is joined to the character
    there, or the frame ends there. None where there is too little or too much.
    """
    pieces = near_pieces(mask, colour, region, predicted)
    columns, rows = pieces.sum(0), pieces.sum(1)
    fill = float(columns.sum()) / (predicted[2] * predicted[3])
    if not LEAST_FILL < fill < MOST_FILL:
        return None
    x0, x1 = trimmed(columns)
    y0, y1 = trimmed(rows)
    box = (float(region.left + x0), float(region.top + y0), float(x1 - x0), float(y1 - y0))
    return box, (x0 > 1, y0 > 1, x1 < region.width - 1, y1 < region.height - 1)


def pulled(weight: Float[np.ndarray, "a b"], region: Region, predicted: Box) -> Box:
    """Shift the predicted box to where it holds the most weight, if that is markedly more.

    The tracker may have stuck to the background while the character walked out of its box.
    """
    step = max(max(predicted[2:]) / 24.0, 1.0)
    offsets = np.arange(-6, 7) * step
    dx, dy = np.meshgrid(offsets, offsets)
    total = box_sums(weight, predicted[0] - region.left + dx, predicted[1] - region.top + dy, predicted[2:])
    area = predicted[2] * predicted[3]
    penalty = PULL_PENALTY * area * (dx**2 + dy**2) / max(predicted[2:]) ** 2
    gain = total - penalty - total[6, 6]
    best = np.unravel_index(int(gain.argmax()), gain.shape)
    if gain[best] < LEAST_PULL * area:
        return predicted
    return predicted[0] + float(dx[best]), predicted[1] + float(dy[best]), predicted[2], predicted[3]


def box_sums(
    weight: Float[np.ndarray, "a b"],
    left: Float[np.ndarray, "*n"],
    top: Float[np.ndarray, "*n"],
    size: tuple[float, ...],
) -> Float[np.ndarray, "*n"]:
    """Sum the weight inside boxes of one size at many places."""
    integral = cv2.integral(weight.astype(np.float32))
    height, width = weight.shape
    x0, x1 = (np.clip(np.round(value), 0, width).astype(int) for value in (left, left + size[0]))
    y0, y1 = (np.clip(np.round(value), 0, height).astype(int) for value in (top, top + size[1]))
    total: np.ndarray = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
    return total


def near_pieces(
    mask: Bool[np.ndarray, "a b"], colour: Float[np.ndarray, "a b"], region: Region, predicted: Box
) -> Bool[np.ndarray, "a b"]:
    """Keep the connected pieces that lie mostly in the predicted box, and the one that fills most of it."""
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    near = inside_box(region, predicted, NEAR)
    overlap = np.bincount(labels.ravel(), weights=near.ravel(), minlength=count)
    area = stats[:, cv2.CC_STAT_AREA]
    kept = (overlap >= LEAST_OVERLAP * area) & (area >= SPECK * predicted[2] * predicted[3])
    kept &= np.bincount(labels.ravel(), weights=colour.ravel(), minlength=count) >= LEAST_COLOUR * area
    overlap[0] = 0.0
    kept[int(overlap.argmax())] = True
    kept[0] = False
    chosen: np.ndarray = kept[labels]
    return chosen


def piece_boxes(mask: Bool[np.ndarray, "h w"], size: tuple[float, float]) -> list[Box]:
    """Bound the large connected pieces of a whole picture's foreground, the largest first."""
    reach = max(3, round(0.06 * max(size)) | 1)
    joined = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((reach, reach), np.uint8))
    _, _, stats, _ = cv2.connectedComponentsWithStats(joined, connectivity=8)
    least = LEAST_PIECE * size[0] * size[1]
    large = sorted((row for row in stats[1:] if row[cv2.CC_STAT_AREA] >= least), key=lambda row: -row[cv2.CC_STAT_AREA])
    return [(float(x), float(y), float(w), float(h)) for x, y, w, h, _ in large[:MOST_PIECES]]


def trimmed(counts: Int[np.ndarray, " n"]) -> tuple[int, int]:
    """Bound a profile, leaving out a little of its mass at each end."""
    total = np.cumsum(counts)
    edge = TRIM * total[-1]
    first = int(np.searchsorted(total, edge, side="right"))
    last = int(np.searchsorted(total, total[-1] - edge, side="left"))
    return first, last + 1
