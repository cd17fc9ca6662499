"""Parts as pictures that stand somewhere on a canvas: what layered formats are written from."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt8

from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.types import Puppet

AXES = "x right, y down, pixels"


class Sprite(NamedTuple):
    """A picture with straight alpha whose upper left corner lies at (left, top) of the canvas."""

    name: str
    rgba: UInt8[np.ndarray, "h w 4"]
    left: int
    top: int


def picture_of(animation: Animation, options: Options) -> tuple[tuple[int, int], list[Sprite], Manifest]:
    """Choose what a layered picture shows: the frame that ``options`` names, else the puppet at rest on its canvas.

    Gives the canvas, the sprites back to front and what the manifest says. Raises InputError for a frame outside the
    run and for one that has no character.
    """
    lost = f"one picture of {len(animation)} frames: no motion, no meshes, no joints"
    puppet = animation.puppet
    if options.picture_frame is None:
        drawn = "" if puppet.reference is None else f", drawn from frame {puppet.reference}"
        said = (f"shows the puppet at rest in canvas pixels{drawn}", lost)
        manifest = Manifest("top left corner of the canvas", AXES, puppet.reference or 0, 1.0, said)
        return puppet.canvas, sprites_at_rest(puppet), manifest
    found = np.flatnonzero(animation.frames == options.picture_frame)
    if not len(found):
        first, last = int(animation.frames[0]), int(animation.frames[-1])
        raise InputError(f"--picture-frame {options.picture_frame}: expected a frame of the run ({first} to {last})")
    manifest = Manifest("top left corner of the picture", AXES, options.picture_frame, 1.0, (lost,))
    return animation.size, sprites_in_frame(animation, int(found[0])), manifest


class Window(NamedTuple):
    """Whole texels of the atlas."""

    x: int
    y: int
    width: int
    height: int


def sprites_at_rest(puppet: Puppet) -> list[Sprite]:
    """Cut each part out of the atlas, back to front: the very texels, in canvas pixels."""
    return [_at_rest(puppet, layer) for layer in range(puppet.num_layers)]


def atlas_window(puppet: Puppet, layer: int) -> Window:
    """Find the whole texels of the atlas that a layer's mesh lies on."""
    uv = puppet.uv[puppet.layer_of_vertex == layer]
    low = np.maximum(np.floor(uv.min(0)).astype(int), 0)
    high = np.minimum(np.ceil(uv.max(0)).astype(int), puppet.atlas.shape[1::-1])
    return Window(*low.tolist(), *(high - low).tolist())


def _at_rest(puppet: Puppet, layer: int) -> Sprite:
    x, y, width, height = atlas_window(puppet, layer)
    mine = np.flatnonzero(puppet.layer_of_vertex == layer)[0]
    left, top = np.rint(puppet.vertices[mine] - puppet.uv[mine]).astype(int).tolist()
    return trimmed(Sprite(puppet.names[layer], puppet.atlas[y : y + height, x : x + width], x + left, y + top))


def trimmed(sprite: Sprite) -> Sprite:
    """Cut off the rows and columns around that are wholly transparent; one pixel stays of a picture without any."""
    alpha = sprite.rgba[..., 3]
    rows, columns = np.flatnonzero(alpha.any(1)), np.flatnonzero(alpha.any(0))
    if not len(rows):
        return Sprite(sprite.name, np.zeros((1, 1, 4), np.uint8), 0, 0)
    (top, bottom), (left, right) = rows[[0, -1]].tolist(), columns[[0, -1]].tolist()
    cut = sprite.rgba[top : bottom + 1, left : right + 1]
    return Sprite(sprite.name, cut, sprite.left + left, sprite.top + top)


def merged(size: tuple[int, int], sprites: Sequence[Sprite]) -> UInt8[np.ndarray, "H W 4"]:
    """Lay the sprites over one another, back to front: straight alpha over transparent black."""
    width, height = size
    light = np.zeros((height, width, 4), np.float32)  # premultiplied
    for sprite in sprites:
        h, w = sprite.rgba.shape[:2]
        x0, y0 = max(sprite.left, 0), max(sprite.top, 0)
        x1, y1 = min(sprite.left + w, width), min(sprite.top + h, height)
        if x1 <= x0 or y1 <= y0:
            continue
        piece = sprite.rgba[y0 - sprite.top : y1 - sprite.top, x0 - sprite.left : x1 - sprite.left].astype(np.float32)
        alpha = piece[..., 3:] / 255.0
        piece[..., :3] *= alpha
        below = light[y0:y1, x0:x1]
        below *= 1.0 - alpha
        below += piece
    return _straight(light / 255.0)


def _straight(premultiplied: Float32[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 4"]:
    """Turn premultiplied colour 0..1 into 8-bit straight alpha; black where nothing is."""
    alpha = np.clip(premultiplied[..., 3:], 0.0, 1.0)
    colour = premultiplied[..., :3] / np.maximum(alpha, 1e-6)
    return np.asarray(np.rint(np.clip(np.concatenate([colour, alpha], -1), 0.0, 1.0) * 255.0), np.uint8)


def over_white(rgba: UInt8[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "h w 3"]:
    """Lay a straight-alpha picture over white."""
    alpha = rgba[..., 3:].astype(np.float32) / 255.0
    return np.asarray(np.rint(rgba[..., :3] * alpha + 255.0 * (1.0 - alpha)), np.uint8)


def sprites_in_frame(animation: Animation, index: int) -> list[Sprite]:
    """Draw each part alone where it is in one frame of the video, back to front, what others hide included.

    Parts end at the picture's border. Raises InputError where the frame has no character.
    """
    frame = animation[index]
    if not frame.is_visible:
        raise InputError(f"frame {frame.number}: the character is lost there; choose another frame")
    from wildpuppet.export.draw import Painter

    painter, names = Painter(animation), animation.puppet.names
    return [trimmed(Sprite(names[layer], painter.picture(frame, int(layer)), 0, 0)) for layer in frame.order]
