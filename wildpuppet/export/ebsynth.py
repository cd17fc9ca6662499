"""EbSynth guides: guide/guide.NNNNN.png and mask/mask.NNNNN.png, for a paint-over of one frame to follow the puppet.

The guide says where on the resting puppet each pixel is: red and green are x and y over the canvas, blue tells the
parts apart. Give it as a guide of the painted frame (source) and of the frame to make (target); the mask is the
puppet's coverage. Eight bits per channel are what EbSynth reads, so a step of the guide is 1/255 of the canvas.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress

if TYPE_CHECKING:
    from wildpuppet.export.draw import Painter

DIGITS = 5


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write a guide and a mask per frame."""
    from wildpuppet.export.draw import Painter
    from wildpuppet.export.seen import Seen

    painter, seen, first = Painter(animation), Seen(animation), options.first_of(int(animation.frames[0]))
    for kind in ("guide", "mask"):
        (folder / kind).mkdir()
    for frame in animation:
        number = f"{first + frame.t:0{DIGITS}d}"
        layer, triangle, mix = seen.at(frame)
        Image.fromarray(_guide(animation, layer, triangle, mix)).save(folder / "guide" / f"guide.{number}.png")
        Image.fromarray(_mask(painter, frame)).save(folder / "mask" / f"mask.{number}.png")
        progress(frame.t + 1, len(animation))
    wide, high = (side / 255.0 for side in animation.puppet.canvas)
    left_out = (
        f"places finer than {wide:.2g} x {high:.2g} canvas pixels",
        "the frames themselves, meshes, joints, times",
    )
    return Manifest("top left corner of the picture", "x right, y down, pixels", first, 1.0, left_out)


def _guide(
    animation: Animation, layer: np.ndarray, triangle: np.ndarray, mix: np.ndarray
) -> UInt8[np.ndarray, "H W 3"]:
    puppet = animation.puppet
    guide = np.zeros((*layer.shape, 3), np.uint8)
    rows, columns = np.nonzero(triangle >= 0)
    corners = puppet.vertices[puppet.triangles[triangle[rows, columns]]]
    places = np.einsum("nkd,nk->nd", corners, mix[rows, columns]) / np.array(puppet.canvas)
    guide[rows, columns, :2] = np.rint(np.clip(places, 0.0, 1.0) * 255.0)
    guide[rows, columns, 2] = np.rint(255.0 * (layer[rows, columns] + 1) / puppet.num_layers)
    return guide


def _mask(painter: "Painter", frame: Frame) -> UInt8[np.ndarray, "H W"]:
    return painter.picture(frame)[..., 3]
