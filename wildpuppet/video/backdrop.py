"""Cut a drawing out of a plain backdrop: the matte of pictures without transparency.

The backdrop's colour is the border's. What is connected to the border and has that colour is surely not the character;
the pixels beside it are mixtures, C = a F + (1 - a) B, whose a is read off the line from the backdrop's colour B to the
colour F that differs most from it nearby (the outline), and whose colour becomes F. An enclosed area of the backdrop's
colour can be a gap between limbs as well as the white of an eye, and no colour tells them apart. Limbs that close a gap
mostly come close to the outside somewhere, so an area near it counts as a gap; a large one deep inside is unknown, a
small one there is the character's. (In the 18 drawings this was set on, gaps are up to 4 % and eyes over 5 % of the
character's size away from the outside.)
"""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

SURE, UNKNOWN, NOT = 255, 128, 0
PLAIN_SHARE = 0.9
"""Share of the border that must have one colour for the backdrop to count as plain."""
TOLERANCE = 12.0
"""Largest channel difference (0..255) from the backdrop's colour; JPEG's ringing reaches about that."""
ENCLOSED_TOLERANCE = 6.0
"""The same for the middle value of an enclosed area."""
ENCLOSED_SHARE = 6e-4
"""Smallest enclosed area that is looked at, as a share of the picture; smaller ones are teeth, claws and glints."""
GAP_SHARE = 0.05
"""Largest distance of a gap from the outside, as a share of the drawing's larger side."""
DEEP_SHARE = 0.03
"""Smallest area deep inside that is unknown, as a share of the drawing's area."""
SPECK_CONTRAST = 40.0
"""What is cut off from the drawing and nowhere differs so much from the backdrop is JPEG's ringing."""
LINE_TOLERANCE = 40.0
"""Distance (0..255) of a mixture from the line between its two colours; beyond it the pixel is the drawing's own."""
REACH = 2
"""Pixels from the backdrop in which mixtures are looked for, and from a mixture in which its colour is."""


def cut_out(rgb: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 4"]:
    """Give straight RGBA: the matte against a plain backdrop, or 255 everywhere where the border has no one colour."""
    colour = border_colour(rgb)
    if colour is None:
        return np.dstack([rgb, np.full(rgb.shape[:2], SURE, np.uint8)])
    offset = rgb.astype(np.float32) - colour
    contrast = np.abs(offset).max(-1)
    areas, _ = ndimage.label(contrast <= TOLERANCE)
    outside = np.isin(areas, _border(areas)) & (areas > 0)
    outside |= _specks(contrast, outside)
    gaps, deep = _enclosed(areas, contrast, outside)
    alpha, straight = _mixtures(offset, contrast, outside | gaps)
    matte = np.rint(SURE * alpha).astype(np.uint8)
    matte[deep] = UNKNOWN
    return np.dstack([np.clip(np.rint(straight + colour), 0, 255).astype(np.uint8), matte])


def border_colour(rgb: UInt8[np.ndarray, "H W 3"]) -> Float[np.ndarray, "3"] | None:
    """Give the colour that nearly all of the picture's border has, or None."""
    border = _border(rgb).astype(np.float32)
    colour = np.median(border, axis=0)
    is_plain = np.mean(np.abs(border - colour).max(-1) <= TOLERANCE) >= PLAIN_SHARE
    return np.asarray(colour) if is_plain else None


def _border(values: np.ndarray) -> np.ndarray:
    """List the values along the four sides."""
    return np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])


def _mixtures(
    offset: Float[np.ndarray, "H W 3"], contrast: Float[np.ndarray, "H W"], outside: Bool[np.ndarray, "H W"]
) -> tuple[Float[np.ndarray, "H W"], Float[np.ndarray, "H W 3"]]:
    """Give alpha and straight colour (less the backdrop's): mixtures are resolved, all else is wholly in or out."""
    alpha, straight = (~outside).astype(np.float32), offset.copy()
    near = ndimage.binary_dilation(outside, np.ones((3, 3)), iterations=REACH) & ~outside
    y, x = np.nonzero(near)
    if not len(y):
        return alpha, straight
    full = _most_different(offset, contrast, y, x)
    mixed = offset[y, x]
    share = (mixed * full).sum(-1) / np.maximum((full * full).sum(-1), 1.0)
    is_mixture = (np.linalg.norm(mixed - share[:, None] * full, axis=-1) <= LINE_TOLERANCE) & (share < 1.0)
    y, x, share, full = y[is_mixture], x[is_mixture], share[is_mixture], full[is_mixture]
    alpha[y, x] = np.maximum(share, 0.0)
    straight[y, x] = full
    return alpha, straight


def _most_different(
    offset: Float[np.ndarray, "H W 3"],
    contrast: Float[np.ndarray, "H W"],
    y: Int[np.ndarray, " N"],
    x: Int[np.ndarray, " N"],
) -> Float[np.ndarray, "N 3"]:
    """Give, for each pixel, the colour within reach that differs most from the backdrop."""
    height, width = contrast.shape
    steps = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1].reshape(2, -1)
    rows = np.clip(y[:, None] + steps[0], 0, height - 1)
    columns = np.clip(x[:, None] + steps[1], 0, width - 1)
    best = contrast[rows, columns].argmax(axis=1)
    each = np.arange(len(y))
    found: Float[np.ndarray, "N 3"] = offset[rows[each, best], columns[each, best]]
    return found


def _specks(contrast: Float[np.ndarray, "H W"], outside: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """Find the pieces that stand alone in the backdrop and hardly differ from it."""
    pieces, count = ndimage.label(~outside)
    most = np.asarray(ndimage.maximum(contrast, pieces, np.arange(count + 1)))
    specks: Bool[np.ndarray, "H W"] = (most < SPECK_CONTRAST)[pieces] & ~outside
    return specks


def _enclosed(
    areas: Int[np.ndarray, "H W"], contrast: Float[np.ndarray, "H W"], outside: Bool[np.ndarray, "H W"]
) -> tuple[Bool[np.ndarray, "H W"], Bool[np.ndarray, "H W"]]:
    """Find the inner areas of the backdrop's colour: (gaps near the outside, large ones deep inside)."""
    inner = np.where(outside, 0, areas)
    sizes = np.bincount(inner.ravel())
    sizes[0] = 0
    large = np.flatnonzero(sizes >= ENCLOSED_SHARE * areas.size)
    like = large[np.asarray(ndimage.median(contrast, inner, large)) <= ENCLOSED_TOLERANCE]
    depths = np.asarray(ndimage.minimum(ndimage.distance_transform_edt(~outside), inner, like))
    y, x = np.nonzero(~outside)
    is_near = depths <= GAP_SHARE * max(_extent(x), _extent(y))
    is_deep = ~is_near & (sizes[like] >= DEEP_SHARE * len(y))
    return np.isin(inner, like[is_near]), np.isin(inner, like[is_deep])


def _extent(places: Int[np.ndarray, " N"]) -> int:
    return int(places.max() - places.min()) + 1 if len(places) else 0
