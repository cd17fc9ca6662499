"""The character's silhouette in one frame: GrabCut from its box, sharpened by a matte where one is known.

GrabCut (Rother, Kolmogorov and Blake 2004) learns the colours inside and outside and cuts along strong edges. Pixels
outside the box are background for sure. Inside, a cartoon's character is fenced by its outlines: what can be reached
from outside without crossing an edge starts as background, what lies behind edges as foreground. That keeps a
background object that the box happens to cut out of the first colour model.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy import ndimage
from skimage.graph import MCP_Geometric

from wildpuppet.puppet.colour import lab

WORKING_PIXELS = 320
"""The box's larger side is reduced to this: GrabCut's time grows with the area, its answer hardly changes."""
CONTEXT = 0.35
"""Background seen around the box, as a share of its larger side."""
ROUNDS = 6
TEXTURE = 2.0
"""Colour change per pixel (Lab units) that is texture, not an outline."""
FENCED, OPEN = 0.3, 0.03
"""Pixels behind more, or less, than these shares of the 90th percentile of colour change start as character, or are
surely background."""
MATTE_BLUR = 1.5
"""Standard deviation, in working pixels, over which the matte is averaged before it counts."""
LIKELY, SURE = 0.2, 0.6
"""From -1 (surely background) to 1: how far the averaged matte decides where GrabCut starts, and where it ends."""
HOLE_SHARE = 0.02
"""A hole of less than this share of the silhouette's area is filled: an eye white, a light belly."""
PIECE_SHARE = 0.05
"""Pieces smaller than this share of the largest one are dropped."""
LEAST_SHARE, MOST_SHARE = 0.08, 0.97
"""Silhouettes that cover less or more of the box than this are taken for a failure; the ellipse stands in."""

Box = tuple[float, float, float, float]
Mask = Bool[np.ndarray, "H W"]


def silhouette_in(
    rgb: UInt8[np.ndarray, "H W 3"], matte: UInt8[np.ndarray, "H W"] | None, box: Box, seed: int
) -> UInt8[np.ndarray, "H W"]:
    """Find the character's alpha (0..255, about one pixel of ramp) over the whole frame.

    ``box`` is x, y, w, h in pixels; nothing outside it is ever foreground. ``matte`` is 255 where the character surely
    is, 0 where it surely is not and 128 where nothing is known.
    """
    window = _window(box, rgb.shape[:2])
    x0, y0, x1, y1 = window
    scale = min(1.0, WORKING_PIXELS / max(box[2], box[3]))
    size = max(1, round((x1 - x0) * scale)), max(1, round((y1 - y0) * scale))
    small = cv2.resize(rgb[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
    small_matte = None if matte is None else cv2.resize(matte[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
    step = size[0] / (x1 - x0), size[1] / (y1 - y0)
    local = (box[0] - x0) * step[0], (box[1] - y0) * step[1], box[2] * step[0], box[3] * step[1]
    mask = _clean(_grabcut(small, _first_guess(small, local, small_matte), seed))
    ellipse, inside = _ellipse(local, size) <= 1.0, _inside(local, size)
    share = mask.sum() / max(1, inside.sum())
    if not LEAST_SHARE <= share <= MOST_SHARE:
        mask = ellipse & inside
    alpha = np.zeros(rgb.shape[:2], np.uint8)
    alpha[y0:y1, x0:x1] = _soft(mask, (x1 - x0, y1 - y0))
    return alpha


def _window(box: Box, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    x, y, w, h = box
    margin = CONTEXT * max(w, h)
    x0, y0 = max(0, int(x - margin)), max(0, int(y - margin))
    return x0, y0, min(shape[1], int(np.ceil(x + w + margin))), min(shape[0], int(np.ceil(y + h + margin)))


def _ellipse(box: Box, size: tuple[int, int]) -> Float[np.ndarray, "h w"]:
    """Measure each pixel's distance from the box's middle; 1 on the ellipse that fits the box."""
    x, y, w, h = box
    across = (np.arange(size[0]) + 0.5 - x - 0.5 * w) / max(0.5 * w, 1e-6)
    down = (np.arange(size[1]) + 0.5 - y - 0.5 * h) / max(0.5 * h, 1e-6)
    distance: Float[np.ndarray, "h w"] = np.hypot(across[None], down[:, None])
    return distance


def _inside(box: Box, size: tuple[int, int]) -> Mask:
    x, y, w, h = box
    across, down = np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5
    inside: Mask = ((across >= x) & (across < x + w))[None] & ((down >= y) & (down < y + h))[:, None]
    return inside


def _first_guess(
    rgb: UInt8[np.ndarray, "h w 3"], box: Box, matte: UInt8[np.ndarray, "h w"] | None
) -> UInt8[np.ndarray, "h w"]:
    inside = _inside(box, (rgb.shape[1], rgb.shape[0]))
    fence = _fence(rgb, inside)
    high = float(np.percentile(fence[inside], 90.0)) if inside.any() else 0.0
    guess = np.where(fence > FENCED * high, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    guess[fence <= OPEN * high] = cv2.GC_BGD
    if matte is not None:
        evidence = ndimage.gaussian_filter(matte.astype(np.float64) / 127.5 - 1.0, MATTE_BLUR)
        guess[evidence >= LIKELY] = cv2.GC_PR_FGD
        guess[evidence <= -LIKELY] = cv2.GC_PR_BGD
        guess[evidence >= SURE] = cv2.GC_FGD
        guess[(evidence <= -SURE) & (fence <= FENCED * high)] = cv2.GC_BGD
    guess[~inside] = cv2.GC_BGD
    return guess


def _fence(rgb: UInt8[np.ndarray, "h w 3"], inside: Mask) -> Float[np.ndarray, "h w"]:
    """Measure how much colour change (Lab units) the easiest path to a pixel from outside the box has to cross."""
    if inside.all():
        inside = inside.copy()
        inside[[0, -1]] = inside[:, [0, -1]] = False
    smooth = cv2.bilateralFilter(lab(rgb.astype(np.float32) / 255), 5, 10.0, 3.0)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, dx, dy, ksize=3, scale=0.25) for dx, dy in ((1, 0), (0, 1)))
    change = np.sqrt((across**2 + down**2).sum(axis=2))
    rim = ndimage.binary_dilation(inside) & ~inside
    costs = np.where(inside | rim, 0.1 + np.maximum(change - TEXTURE, 0.0), -1.0)  # negative: closed
    fence: Float[np.ndarray, "h w"] = MCP_Geometric(costs).find_costs(np.argwhere(rim))[0]
    return np.where(inside, fence, 0.0)


def _grabcut(rgb: UInt8[np.ndarray, "h w 3"], guess: UInt8[np.ndarray, "h w"], seed: int) -> Mask:
    could_be: Mask = (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)
    if not could_be.any() or could_be.all():
        return could_be
    cv2.setRNGSeed(seed)  # GrabCut's first clusters are random
    mask, background, foreground = guess.copy(), np.zeros((1, 65)), np.zeros((1, 65))
    picture = np.ascontiguousarray(rgb[..., ::-1])
    cv2.grabCut(picture, mask, (0, 0, 1, 1), background, foreground, ROUNDS, cv2.GC_INIT_WITH_MASK)
    found: Mask = (mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD)
    return found


def _clean(mask: Mask) -> Mask:
    """Smooth by about a pixel, keep the large pieces, fill small holes."""
    smooth = cv2.medianBlur(mask.astype(np.uint8), 5)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(smooth, connectivity=4)
    if count < 2:
        return mask
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    kept: Mask = (areas >= PIECE_SHARE * areas.max())[labels] & (labels > 0)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~np.pad(kept, 1)).astype(np.uint8), connectivity=4)
    is_small = stats[:, cv2.CC_STAT_AREA] < HOLE_SHARE * kept.sum()
    is_small[[0, labels[0, 0]]] = False
    filled: Mask = kept | is_small[labels[1:-1, 1:-1]]
    return filled


def _soft(mask: Bool[np.ndarray, "h w"], size: tuple[int, int]) -> UInt8[np.ndarray, "H W"]:
    """Enlarge a mask to ``size`` (w, h) with an edge of about one pixel, half a pixel inside the mask's."""
    inner = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    outer = ndimage.distance_transform_edt(~np.pad(mask, 1))[1:-1, 1:-1]
    signed = ndimage.gaussian_filter(np.where(mask, inner - 0.5, 0.5 - outer), 0.7)
    scale = size[0] / mask.shape[1]
    large = cv2.resize(signed.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) * scale
    alpha: UInt8[np.ndarray, "H W"] = np.clip(np.round(255.0 * large), 0, 255).astype(np.uint8)
    return alpha
