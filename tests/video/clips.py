"""Draw and encode clips whose frames carry their own number as a bar code, so that any wrong frame is caught."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

BITS = 8
WIDTH, HEIGHT = 160, 96


def bar_code(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """A picture whose left bar tells left from right, with the bits of ``number`` as black and white bars."""
    picture = np.full((height, width, 3), 90, np.uint8)
    picture[: height // 4, : width // 4] = (200, 30, 30)
    for bit in range(BITS):
        left, right = width * bit // BITS, width * (bit + 1) // BITS
        picture[height // 2 : 3 * height // 4, left:right] = 255 if number >> bit & 1 else 0
    return picture


def number_in(picture: np.ndarray) -> int:
    """Read the bar code of an upright picture."""
    height, width = picture.shape[:2]
    bars = [picture[5 * height // 8, width * (2 * bit + 1) // (2 * BITS)].mean() for bit in range(BITS)]
    assert all(bar < 60 or bar > 195 for bar in bars), bars
    assert picture[height // 8, width // 8, 0] > 150 > 100 > picture[height // 8, width // 8, 2]
    return sum(int(bar > 127) << bit for bit, bar in enumerate(bars))


def encode(
    path: Path,
    pictures: Sequence[np.ndarray],
    pts: Sequence[int] | None = None,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    rotation: int = 0,
    cover: bool = False,
    **options: str,
) -> Path:
    """Encode pictures at ``pts`` (in 1/600 s; 25 a second where none are given); MP4 files start with their index."""
    time_base = Fraction(1, 25) if pts is None else Fraction(1, 600)
    with av.open(str(path), "w", options={"movflags": "faststart"} if path.suffix == ".mp4" else {}) as container:
        picture_of_disc = _add_cover(container) if cover else None
        stream = container.add_stream(codec, rate=25, options=options)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = pixel_format
        stream.codec_context.time_base = time_base
        if rotation:
            stream.set_display_rotation(rotation)
        if picture_of_disc is not None:
            frame = av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8), format="rgb24")
            container.mux(picture_of_disc.encode(frame) + picture_of_disc.encode())
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = (number if pts is None else pts[number]), time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _add_cover(container: av.container.OutputContainer) -> av.video.stream.VideoStream:
    stream = container.add_stream("mjpeg", rate=1)
    stream.width = stream.height = 32
    stream.pix_fmt = "yuvj420p"
    stream.disposition = av.stream.Disposition.attached_pic
    return stream
