"""PC2 point cache with an OBJ: puppet.obj, puppet.mtl, atlas.png, puppet.pc2.

Little endian: "POINTCACHE2", version 1, number of points, first frame, frames between samples, number of samples, then
x, y, z of every point of every sample (32-bit floats). It counts frames and knows no times.
"""

import struct
from pathlib import Path

import numpy as np

from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.export.point_cache import corners_of
from wildpuppet.machine import Progress

HEAD = struct.Struct("<12siiffi")


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write the four files, the cache a frame at a time."""
    corners = corners_of(animation, options.units_per_pixel)
    corners.write_obj(folder)
    path, first = folder / "puppet.pc2", options.first_of(int(animation.frames[0]))
    with path.open("wb") as file:
        file.write(HEAD.pack(b"POINTCACHE2\0", 1, corners.count, first, 1.0, len(animation)))
        for frame in animation:
            file.write(corners.at(frame).astype("<f4").tobytes())
            progress(frame.t + 1, len(animation))
    stored = np.memmap(path, "<f4", "r", HEAD.size, (len(animation), corners.count, 3))
    uneven = ("the clip's uneven times: the cache counts frames",) if animation.timing.is_variable else ()
    return Manifest(
        "top left corner of the picture",
        "x right, y up, z towards the eye: layers by depth",
        first,
        options.units_per_pixel,
        ("frame rate", *uneven, *corners.left_out()),
        corners.error(stored, "numpy"),
    )
