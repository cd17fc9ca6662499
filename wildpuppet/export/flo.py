"""Middlebury .flo: where each pixel of the character goes from one frame to the next, FRAME.flo for frame FRAME.

Each file is "PIEH", width, height, then (x, y) moves in pixels as 32-bit floats, row by row; 1e10 where nothing is
known, which is beside the character. A move is that of the point at the pixel's centre. There is no file for the last
frame of a shot, nor where the character is lost in either frame.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float32

from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest, rounding_error
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress

TAG = b"PIEH"
UNKNOWN = 1.0e10


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write one file per pair of neighbouring frames."""
    from wildpuppet.export.seen import Seen

    seen = Seen(animation)
    first = options.first_of(int(animation.frames[0]))
    for t in range(len(animation) - 1):
        start, end = animation[t], animation[t + 1]
        if start.is_visible and end.is_visible and start.shot == end.shot:
            _, triangle, mix = seen.at(start)
            rows, columns = np.nonzero(triangle >= 0)
            corners = animation.puppet.triangles[triangle[rows, columns]]
            moves = np.einsum("nkd,nk->nd", (end.vertices - start.vertices)[corners], mix[rows, columns])
            flow = np.full((*triangle.shape, 2), UNKNOWN, np.float32)
            flow[rows, columns] = moves
            (folder / f"{first + t:06d}.flo").write_bytes(encode(flow))
        progress(t + 1, len(animation))
    progress(len(animation), len(animation))
    left_out = (
        "no file: the last frame of each shot, and frames before or after which the character is lost",
        "meshes, textures, layers, times",
    )
    error = rounding_error(animation, lambda places: places.astype(np.float32).astype(np.float64))
    return Manifest("top left corner of the picture", "x right, y down, pixels", first, 1.0, left_out, error)


def encode(flow: Float32[np.ndarray, "H W 2"]) -> bytes:
    """Encode one file."""
    height, width = flow.shape[:2]
    return TAG + np.array([width, height], "<i4").tobytes() + flow.astype("<f4").tobytes()
