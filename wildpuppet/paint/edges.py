"""Paint along the outline of a part: the frame's own edge, not the fitted one, says how far it goes.

A fit is off by a pixel or two, so the old paint would show as a rim beyond the new. Near an outline every pixel of
the frame is read as a mixture ``a * old + (1 - a) * beyond`` of the part's old colour at its rim and of what lies
beyond it; the same share of the new colour is put there. Where old and beyond look alike, nothing is done.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from wildpuppet.paint.layers import Drawn

LEAST_CONTRAST = 0.12
"""Distance of two colours (0..1) from which a mixture of them can be told."""
LEAST_SHARE = 0.12
"""Smaller shares are grain."""
OFF_LINE = 0.25
"""A colour this far from the line between the two is no mixture of them."""

Colours = Float32[np.ndarray, "h w 3"]
Picture = Float32[np.ndarray, "h w 4"]


class _View(NamedTuple):
    """The surroundings of one painted part; ``own`` marks where it is seen."""

    frame: Colours
    before: Picture
    after: Picture
    own: Bool[np.ndarray, "h w"]
    changed: Bool[np.ndarray, "h w"]


def along_outlines(
    result: Colours, frame: Colours, before: Picture, after: Picture, drawn: Drawn, reach: int
) -> Colours:
    """Correct ``result`` near the outlines of the parts that were painted."""
    for layer in np.unique(drawn.layer[drawn.changed]).tolist():
        if layer < 0:
            continue
        own = drawn.layer == layer
        window = _around(own & drawn.changed, reach + 4)
        view = _View(frame[window], before[window], after[window], own[window], drawn.changed[window])
        result[window] = _along(result[window], view, reach)
    return result


def _around(mask: Bool[np.ndarray, "h w"], border: int) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (
        slice(max(int(rows[0]) - border, 0), int(rows[-1]) + border + 1),
        slice(max(int(columns[0]) - border, 0), int(columns[-1]) + border + 1),
    )


def _along(result: Colours, view: _View, reach: int) -> Colours:
    frame, before, after, own, changed = view
    inner, beyond = _eroded(own, 1) & (before[..., 3] > 0.95), ~_grown(own, reach)
    if not inner.any() or not beyond.any():
        return result
    distance, place = _nearest_place(inner)
    _, rim = _nearest_place(own)
    band = changed[place] & changed[rim] & ~inner & (distance <= reach + 2)
    old, new = (picture[place[0][band], place[1][band]] for picture in (before, after))
    _, outside = _nearest_place(beyond)
    back = frame[outside[0][band], outside[1][band]]
    old_colour = old[:, :3] / old[:, 3:]
    share = np.zeros(own.shape, np.float32)
    share[band], is_clear = _shares(frame[band], old_colour, back)
    share = _falling(share, own, reach)
    mixed = frame[band] + share[band][:, None] * (new[:, :3] + (1.0 - new[:, 3:]) * back - old_colour)
    taken = is_clear & ((share[band] > 0.0) | own[band])
    corrected = result.copy()
    corrected[band] = np.where(taken[:, None], mixed, result[band])
    return corrected


def _shares(
    mixed: Float32[np.ndarray, "n 3"], old: Float32[np.ndarray, "n 3"], back: Float32[np.ndarray, "n 3"]
) -> tuple[Float32[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Read mixtures: the share of ``old`` in each, and whether it can be told."""
    line = old - back
    length = (line * line).sum(-1)
    share = np.clip(((mixed - back) * line).sum(-1) / np.maximum(length, 1e-6), 0.0, 1.0)
    off = np.linalg.norm(mixed - back - share[:, None] * line, axis=-1)
    is_clear = (length > LEAST_CONTRAST**2) & (off < OFF_LINE)
    return np.where(is_clear & (share > LEAST_SHARE), share, 0.0).astype(np.float32), is_clear


def _falling(share: Float32[np.ndarray, "h w"], own: Bool[np.ndarray, "h w"], reach: int) -> Float32[np.ndarray, "h w"]:
    """Let shares beyond the outline only fall: what does not hang together with the part is something else."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    reached = np.where(own, 1.0, 0.0).astype(np.float32)
    for _ in range(reach):
        reached = np.maximum(reached, np.minimum(share, cv2.dilate(reached, cross)))
    return np.where(own, share, np.where(reached > 0.0, np.minimum(share, reached), 0.0)).astype(np.float32)


def _nearest_place(
    mask: Bool[np.ndarray, "h w"],
) -> tuple[Float32[np.ndarray, "h w"], tuple[np.ndarray, np.ndarray]]:
    """Give every pixel's distance to the nearest marked one, and that one's row and column."""
    distance, label = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    rows, columns = np.nonzero(mask)
    table = np.zeros((int(label.max()) + 1, 2), np.int64)
    table[label[mask]] = np.stack([rows, columns], -1)
    return distance, (table[label][..., 0], table[label][..., 1])


def _eroded(mask: Bool[np.ndarray, "h w"], by: int) -> Bool[np.ndarray, "h w"]:
    kernel = np.ones((2 * by + 1, 2 * by + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel, borderValue=1) > 0)


def _grown(mask: Bool[np.ndarray, "h w"], by: int) -> Bool[np.ndarray, "h w"]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1, 2 * by + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)
