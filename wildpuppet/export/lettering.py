"""Small text on pictures."""

from functools import lru_cache

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
WHITE: Colour = (255, 255, 255)


@lru_cache(maxsize=8)
def _font(pixels: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(pixels)


def text_width(text: str, pixels: int = 14) -> int:
    """Width of a line of text."""
    return int(np.ceil(_font(pixels).getlength(text)))


def write_text(
    image: UInt8[np.ndarray, "H W 3"], place: tuple[int, int], text: str, colour: Colour = WHITE, pixels: int = 14
) -> None:
    """Write one line into ``image`` (in place), its upper left corner at ``place``; what does not fit is cut off."""
    left, top = place
    strip = image[top : top + int(pixels * 1.5), left:]
    if strip.size:
        picture = Image.fromarray(np.ascontiguousarray(strip))
        ImageDraw.Draw(picture).text((0, 0), text, fill=colour, font=_font(pixels))
        strip[...] = np.asarray(picture)
