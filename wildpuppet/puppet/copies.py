"""Parts that were all cut from one drawing, generously: give every pixel of the drawing to one part only.

Such parts (the paper's case) show what is not theirs. A hand has a fringe of the tail behind it; the tail has the hand
painted on it. Left in, the tail explains a hand wherever the tail is, and the hand, moved, drags a piece of tail along.
First a part in front loses its fringe: colour that runs in from the part behind, across the cut, up to the outline.
Then a part behind loses what is painted on it: its covered pixels are filled from its visible ones. Whole part art,
which goes on below the parts in front in colours of its own, is told by just that and left as it is.
"""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.puppet.colour import lab
from wildpuppet.puppet.complete import complete_colour, grow
from wildpuppet.types import CutOut, Part

SAME = 12
"""Largest difference (0..255, any channel) between two parts' pixels that are one pixel of a drawing."""
COPIED_SHARE = 0.8
"""Share of the pixels under a part that must be copies: whole art that happens to share a colour stays as it is."""
LEAST_PIXELS = 16
"""Fewer covered pixels than this say nothing."""
EDGE = 2
"""Pixels beside a copy that its outline and its soft edge still colour."""
INSET = 3
"""Pixels along a part's edge that lend no colour: its outline and the paper that shines through."""
FRINGE_SHARE = 0.35
"""How deep a fringe may be, as a share of the part's largest inscribed radius."""
FRINGE_STEP = 10.0
"""Largest change of colour (Lab) from pixel to pixel within a fringe."""
FOLLOW = 0.3
"""How quickly the colour that a fringe is compared with follows it."""
OPAQUE = 250


def without_copies(cutout: CutOut, least_alpha: int) -> CutOut:
    """Trim and fill parts that show the parts around them; see the module. Whole art comes back as it is."""
    parts = list(cutout.parts)
    for number in range(1, len(parts)):
        parts[number] = _trimmed(parts[number], parts[:number], least_alpha)
    for number in range(len(parts) - 1):
        parts[number] = _filled(parts[number], parts[number + 1 :], least_alpha)
    return replace(cutout, parts=tuple(parts))


def _flattened(
    parts: list[Part], window: tuple[slice, slice]
) -> tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """Lay parts (back to front) over each other; where none is opaque the second answer is False."""
    colour = np.zeros((*parts[0].rgba[window].shape[:2], 3), np.uint8)
    is_covered = np.zeros(colour.shape[:2], bool)
    for part in parts:
        is_opaque = part.rgba[window][..., 3] >= OPAQUE
        colour[is_opaque] = part.rgba[window][is_opaque, :3]
        is_covered |= is_opaque
    return colour, is_covered


def _shared(
    colour: UInt8[np.ndarray, "h w 3"],
    is_own: Bool[np.ndarray, "h w"],
    other: UInt8[np.ndarray, "h w 3"],
    is_other: Bool[np.ndarray, "h w"],
) -> Bool[np.ndarray, "h w"]:
    """Where two pictures show the same pixel; nowhere, unless most of what they share is the same."""
    is_both = is_own & is_other
    is_same = is_both & (np.abs(colour.astype(np.int16) - other).max(-1) <= SAME)
    is_one_drawing = is_both.sum() >= LEAST_PIXELS and is_same.sum() >= COPIED_SHARE * is_both.sum()
    shared: Bool[np.ndarray, "h w"] = is_same & is_one_drawing
    return shared


def _window(part: Part, least_alpha: int) -> tuple[slice, slice] | None:
    rows, columns = np.nonzero(part.rgba[..., 3] >= least_alpha)
    if not len(rows):
        return None
    return slice(max(0, rows.min() - 1), rows.max() + 2), slice(max(0, columns.min() - 1), columns.max() + 2)


def _trimmed(part: Part, behind: list[Part], least_alpha: int) -> Part:
    window = _window(part, least_alpha)
    if window is None:
        return part
    rgba = part.rgba[window]
    is_own = rgba[..., 3] >= least_alpha
    colour, is_behind = _flattened(behind, window)
    is_same = _shared(rgba[..., :3], is_own, colour, is_behind)
    if not is_same.any():
        return part
    radius = float(cv2.distanceTransform(np.pad(is_own, 1).astype(np.uint8), cv2.DIST_L2, 5).max())
    own, other = (lab(image.astype(np.float32) / 255) for image in (rgba[..., :3], colour))
    is_fringe = _fringe(own, other, is_same, is_behind & ~is_own, int(FRINGE_SHARE * radius))
    trimmed = part.rgba.copy()
    trimmed[window][is_fringe, 3] = 0
    return replace(part, rgba=trimmed)


def _fringe(
    own: Float[np.ndarray, "h w 3"],
    behind: Float[np.ndarray, "h w 3"],
    is_open: Bool[np.ndarray, "h w"],
    is_seed: Bool[np.ndarray, "h w"],
    depth: int,
) -> Bool[np.ndarray, "h w"]:
    """Let the colour behind run in from the seeds over open pixels, at most ``depth`` far, while it changes little."""
    reached, model = is_seed.copy(), np.where(is_seed[..., None], behind, 0).astype(np.float32)
    for _ in range(depth):
        is_new = np.zeros_like(reached)
        source = np.zeros_like(model)
        for is_beside, beside in zip(_sides(reached), _sides(model), strict=True):
            is_next = is_open & ~reached & is_beside
            is_next &= np.linalg.norm(own - beside, axis=-1) < FRINGE_STEP
            source[is_next] = beside[is_next]
            is_new |= is_next
        if not is_new.any():
            break
        model[is_new] = (1 - FOLLOW) * source[is_new] + FOLLOW * own[is_new]
        reached |= is_new
    fringe: Bool[np.ndarray, "h w"] = reached & ~is_seed
    return fringe


def _sides(image: np.ndarray) -> Iterator[np.ndarray]:
    """Give, for each of four sides, the image of every pixel's neighbour on that side (0 beyond the edge)."""
    padded = np.pad(image, ((1, 1), (1, 1)) + ((0, 0),) * (image.ndim - 2))
    height, width = image.shape[:2]
    for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
        yield padded[row : row + height, column : column + width]


def _filled(part: Part, front: list[Part], least_alpha: int) -> Part:
    window = _window(part, least_alpha)
    if window is None:
        return part
    rgba = np.ascontiguousarray(part.rgba[window])
    is_own = rgba[..., 3] >= least_alpha
    colour, is_front = _flattened(front, window)
    if not _shared(rgba[..., :3], is_own, colour, is_front).any():
        return part
    trust: Float[np.ndarray, "h w"] = (is_own & ~grow(is_own & is_front, EDGE)).astype(np.float64)
    if not trust.any():
        return part
    filled = part.rgba.copy()
    filled[window][..., :3] = complete_colour(np.ascontiguousarray(rgba[..., :3]), trust, is_own, inset=INSET)
    return replace(part, rgba=filled)
