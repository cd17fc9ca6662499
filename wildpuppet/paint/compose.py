"""Lay the painted puppet into one frame so that all else stays as it was, to the bit.

Where paint covers the character, the model of a pixel is ``puppet + (1 - alpha) * behind``, before and after painting.
What the frame shows beside the model (grain, a line a pixel off) is kept where little was painted and dropped where
much was: ``frame = after + (1 - weight) * (frame - before)``. Along outlines the frame's own edge decides
(``edges.py``), and what lies in front of the character stays (``covered.py``).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from wildpuppet.paint.covered import Palettes, uncovered
from wildpuppet.paint.edges import along_outlines
from wildpuppet.paint.layers import Drawn

FAINT, STRONG = 0.04, 0.2
"""Change of colour (0..1) up to which the frame's own detail stays, and from which it goes."""

Colours = Float32[np.ndarray, "h w 3"]


@dataclass(frozen=True)
class Look:
    """How a frame shows the puppet: ``light`` per channel, and ``reach``: pixels that its outlines may be off by."""

    light: tuple[float, float, float] = (1.0, 1.0, 1.0)
    reach: int = 3


def painted(
    picture: UInt8[np.ndarray, "H W 3"],
    drawn: Drawn,
    palettes: Palettes,
    look: Look,
    behind: UInt8[np.ndarray, "H W 3"] | None,
) -> UInt8[np.ndarray, "H W 3"]:
    """Paint one frame. ``behind``: the picture without the character; None where nothing was erased."""
    if not drawn.changed.any():
        return picture
    frame = picture[drawn.window].astype(np.float32) / 255.0
    light = np.array([*look.light, 1.0], np.float32)
    before, after = drawn.before * light, drawn.after * light
    back = nearby_background(frame, before) if behind is None else behind[drawn.window].astype(np.float32) / 255.0
    result = inside(frame, before, after, back, drawn)
    result = along_outlines(result, frame, before, after, drawn, look.reach)
    shown = uncovered(frame, over(before, back), drawn, palettes, look.light, look.reach)[..., None]
    result = frame + shown * (result - frame)
    whole = picture.copy()
    whole[drawn.window] = np.rint(np.clip(result, 0.0, 1.0) * 255.0).astype(np.uint8)
    return whole


def over(puppet: Float32[np.ndarray, "h w 4"], back: Colours) -> Colours:
    """Lay a premultiplied picture over a background."""
    return np.asarray(puppet[..., :3] + (1.0 - puppet[..., 3:]) * back)


def inside(
    frame: Colours,
    before: Float32[np.ndarray, "h w 4"],
    after: Float32[np.ndarray, "h w 4"],
    back: Colours,
    drawn: Drawn,
) -> Colours:
    """Replace what was painted much, and shift what was painted a little."""
    change = np.abs(after - before).max(-1)
    share = np.clip((change - FAINT) / (STRONG - FAINT), 0.0, 1.0)
    weight = (share * share * (3.0 - 2.0 * share))[..., None]
    result = over(after, back) + (1.0 - weight) * (frame - over(before, back))
    return np.asarray(np.where(drawn.changed[..., None], result, frame), np.float32)


def nearby_background(frame: Colours, before: Float32[np.ndarray, "h w 4"]) -> Colours:
    """Give every pixel the colour of the nearest one that shows nothing of the puppet."""
    puppet = cv2.dilate((before[..., 3] > 0.0).astype(np.uint8), np.ones((5, 5), np.uint8))
    return nearest(frame, np.asarray(puppet == 0))


def nearest(values: Float32[np.ndarray, "h w c"], known: np.ndarray) -> Float32[np.ndarray, "h w c"]:
    """Give every pixel the value of the nearest known one; where none is known, its own."""
    if known.all() or not known.any():
        return values
    unknown = (~known).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    table = np.zeros((int(label.max()) + 1, values.shape[-1]), np.float32)
    table[label[known]] = values[known]
    return np.asarray(table[label])
