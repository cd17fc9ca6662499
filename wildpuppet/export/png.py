"""RGBA layers as PNG sequences: one folder per part and one of the whole puppet, straight alpha, the video's size.

Every editor imports them. The parts are drawn whole, not cut by what covers them, so that they can be moved; stacked
in the manifest's order they give the combined picture.
"""

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet.export.animation import Animation
from wildpuppet.export.draw import Painter
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress

COMPRESSION = 4
"""zlib level: 9 is a few percent smaller and several times slower."""
DIGITS = 5
COMBINED = "combined"


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write FOLDER/combined/combined.NNNNN.png and FOLDER/layers/PART/PART.NNNNN.png."""
    painter, first = Painter(animation), options.first_of(int(animation.frames[0]))
    places = [(None, folder / COMBINED / COMBINED), *layer_stems(animation, folder)]
    total = len(places) * len(animation)
    for place, (layer, stem) in enumerate(places):
        for t in write_sequence(painter.pictures(layer), stem, first):
            progress(place * len(animation) + t + 1, total)
    return Manifest("top left corner of the picture", "x right, y down", first, left_out=left_out(animation))


def write_sequence(pictures: Iterable[UInt8[np.ndarray, "H W 4"]], stem: Path, first: int) -> Iterator[int]:
    """Write pictures as STEM.NNNNN.png and give each one's index when it is written; a repeated one is copied."""
    stem.parent.mkdir(parents=True)
    before, last = None, stem
    for t, picture in enumerate(pictures):
        path = numbered(stem, first + t)
        if picture is before:
            shutil.copyfile(last, path)
        else:
            Image.fromarray(picture).save(path, compress_level=COMPRESSION)
        before, last = picture, path
        yield t


def numbered(stem: Path, number: int) -> Path:
    """Name the file of one frame."""
    return stem.with_name(f"{stem.name}.{number:0{DIGITS}d}.png")


def layer_stems(animation: Animation, folder: Path) -> list[tuple[int, Path]]:
    """Say where each layer's pictures go: FOLDER/layers/PART/PART, without number and suffix."""
    stems = file_names(animation.puppet.names)
    return [(layer, folder / "layers" / stem / stem) for layer, stem in enumerate(stems)]


def left_out(animation: Animation, has_times: bool = False) -> tuple[str, ...]:
    """Say what pictures of layers cannot hold."""
    words = ["meshes and joints: the layers are pictures"]
    if len(animation.order_changes) > 1:
        words.append("changes of the draw order: restack the layers where order_back_to_front says so")
    if animation.timing.is_variable and not has_times:
        words.append("the variable frame rate: picture i is shown at pts[i] * time_base seconds")
    return tuple(words)
