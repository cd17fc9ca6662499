"""MDD point cache with an OBJ: puppet.obj, puppet.mtl, atlas.png, puppet.mdd.

Big endian: number of frames, number of points (32-bit whole numbers), the frames' times in seconds, then x, y, z of
every point of every frame (32-bit floats). Times are the frames' own, so a variable frame rate is kept.
"""

from pathlib import Path

import numpy as np

from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.export.point_cache import corners_of
from wildpuppet.machine import Progress


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write the four files, the cache a frame at a time."""
    corners = corners_of(animation, options.units_per_pixel)
    corners.write_obj(folder)
    path, shape = folder / "puppet.mdd", (len(animation), corners.count)
    with path.open("wb") as file:
        file.write(np.array(shape, ">i4").tobytes())
        file.write(np.array([float(frame.seconds) for frame in animation], ">f4").tobytes())
        for frame in animation:
            file.write(corners.at(frame).astype(">f4").tobytes())
            progress(frame.t + 1, len(animation))
    stored = np.memmap(path, ">f4", "r", 8 + 4 * len(animation), (*shape, 3))
    return Manifest(
        "top left corner of the picture",
        "x right, y up, z towards the eye: layers by depth",
        0,
        options.units_per_pixel,
        corners.left_out(),
        corners.error(stored, "numpy"),
    )
