"""Write a preview that every player shows right: H.264 in MP4, BT.709 both converted and tagged, exact times."""

from collections.abc import Iterable
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream
from jaxtyping import Int, UInt8

from wildpuppet.video.encode import written_beside

QUALITY = 18
"""x264's CRF; 18 is hard to tell from the source, 6 more halves the file."""
PRESET = "veryfast"
"""x264's preset: a third of the time of its usual one, for a preview that is a little larger."""
THREADS = 4
"""Fixed, because the bytes depend on it."""
SAME_BYTES = "mbtree=0"
"""x264's macroblock tree gives the same small pictures other bytes from one time to the next."""
MOST_TICKS = 2**31 - 1


def constant_times(num_frames: int, rate: Fraction) -> tuple[Int[np.ndarray, " T"], Fraction]:
    """Give the times of frames that last equally long: (pts, time base)."""
    return np.arange(num_frames, dtype=np.int64), 1 / rate


def write_preview(
    path: Path, frames: Iterable[UInt8[np.ndarray, "H W 3"]], pts: Int[np.ndarray, " T"], time_base: Fraction
) -> None:
    """Encode RGB frames at exactly the times ``pts * time_base``, counted from the first; uneven times are kept.

    Sides are padded to even numbers by repeating the last row and column. Writing the same frames again gives the same
    bytes. The file appears whole or not at all. Raises ValueError where there are no frames, or not one per time.
    """
    pictures = iter(frames)
    first = next(pictures, None)
    if first is None or len(pts) == 0:
        raise ValueError("expected at least one frame and one time")
    with written_beside(path, "mp4", movflags="+faststart") as container:
        times = (np.asarray(pts, np.int64) - int(pts[0])).tolist()
        stream = container.add_stream(
            "libx264", options={"crf": str(QUALITY), "preset": PRESET, "x264-params": SAME_BYTES}
        )
        _describe(stream, first, time_base)
        durations = np.diff(times, append=2 * times[-1] - times[-2] if len(times) > 1 else 1).tolist()
        for picture, time, duration in zip(chain([first], pictures), times, durations, strict=True):
            frame = _frame(picture)
            frame.pts, frame.time_base, frame.duration = time, time_base, duration
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _describe(stream: VideoStream, picture: UInt8[np.ndarray, "H W 3"], time_base: Fraction) -> None:
    height, width = picture.shape[:2]
    stream.width, stream.height = width + width % 2, height + height % 2
    stream.pix_fmt = "yuv420p"
    stream.time_base = time_base
    codec = stream.codec_context
    codec.time_base = time_base
    codec.thread_count = THREADS
    codec.colorspace = Colorspace.ITU709
    codec.color_range = ColorRange.MPEG
    codec.color_primaries = ColorPrimaries.BT709
    codec.color_trc = ColorTrc.BT709


def _frame(picture: UInt8[np.ndarray, "H W 3"]) -> av.VideoFrame:
    height, width = picture.shape[:2]
    even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
    return frame.reformat(
        format="yuv420p",
        dst_colorspace=Colorspace.ITU709,
        dst_color_range=ColorRange.MPEG,
        interpolation="BICUBIC",
    )
