"""OpenRaster (ORA): one layer per part under its name, where it lies.

The OpenRaster specification, baseline: a zip whose first member is the stored ``mimetype``, then ``stack.xml`` (topmost
layer first), one PNG per layer, the merged picture and a thumbnail. The same sprites give the same bytes.
"""

import zipfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names, printable
from wildpuppet.export.options import Options
from wildpuppet.export.sprites import Sprite, merged, picture_of
from wildpuppet.machine import Progress

FIRST_DATE = (1980, 1, 1, 0, 0, 0)
THUMBNAIL_SIDE = 256


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.ora: one layer per part, at rest or in the frame that ``options`` names."""
    size, sprites, manifest = picture_of(animation, options)
    write_ora(folder / f"{file_names([animation.name])[0]}.ora", size, sprites)
    progress(1, 1)
    return manifest


def write_ora(path: Path, size: tuple[int, int], sprites: Sequence[Sprite]) -> None:
    """Write a document of ``size`` (W, H) with ``sprites`` back to front; they may reach beyond the canvas."""
    whole = Image.fromarray(merged(size, sprites))
    small = whole.copy()
    small.thumbnail((THUMBNAIL_SIDE, THUMBNAIL_SIDE))
    with zipfile.ZipFile(path, "w") as archive:
        _add(archive, "mimetype", b"image/openraster")
        _add(archive, "stack.xml", _stack(size, sprites))
        for number, sprite in enumerate(sprites):
            _add(archive, _source(number), _png(sprite.rgba))
        _add(archive, "mergedimage.png", _encoded(whole))
        _add(archive, "Thumbnails/thumbnail.png", _encoded(small))


def _stack(size: tuple[int, int], sprites: Sequence[Sprite]) -> bytes:
    image = ElementTree.Element("image", {"version": "0.0.5", "w": str(size[0]), "h": str(size[1])})
    stack = ElementTree.SubElement(image, "stack")
    for number in reversed(range(len(sprites))):
        sprite = sprites[number]
        place = {"x": str(sprite.left), "y": str(sprite.top)}
        look = {"opacity": "1.0", "visibility": "visible", "composite-op": "svg:src-over"}
        named = {"name": printable(sprite.name), "src": _source(number)}
        ElementTree.SubElement(stack, "layer", {**named, **place, **look})
    return bytes(ElementTree.tostring(image, encoding="UTF-8", xml_declaration=True))


def _source(number: int) -> str:
    return f"data/layer{number:03d}.png"


def _png(rgba: UInt8[np.ndarray, "h w 4"]) -> bytes:
    return _encoded(Image.fromarray(np.ascontiguousarray(rgba)))


def _encoded(image: Image.Image) -> bytes:
    data = BytesIO()
    image.save(data, format="PNG")
    return data.getvalue()


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Store a member; pictures are packed already, and the specification wants ``mimetype`` unpacked."""
    archive.writestr(zipfile.ZipInfo(name, FIRST_DATE), data, zipfile.ZIP_STORED)
