"""Video with transparency: ProRes 4444 for editors, VP9 in WebM for browsers; straight alpha, BT.709, tagged.

PyAV converts RGB by BT.601 and writes no tags unless it is told; players then guess by the picture's size and colours
shift. Here the matrix and the tags are both BT.709, limited range. ProRes keeps times exactly (its container counts
in ``time_base``); WebM counts milliseconds.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Literal

import av
import numpy as np
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream
from jaxtyping import Int, UInt8

from wildpuppet.video.encode import written_beside

THREADS = 4
"""Fixed, because the bytes depend on it."""


@dataclass(frozen=True)
class _Kind:
    container: str
    codec: str
    pixels: str
    options: dict[str, str]


KINDS: dict[str, _Kind] = {
    "prores": _Kind("mov", "prores_ks", "yuva444p10le", {"profile": "4444", "alpha_bits": "16", "vendor": "apl0"}),
    "webm": _Kind(
        "webm", "libvpx-vp9", "yuva420p",
        {"crf": "6", "b": "0", "deadline": "good", "cpu-used": "4", "auto-alt-ref": "0"},
    ),
}  # fmt: skip


def write_alpha(
    path: Path,
    frames: Iterable[UInt8[np.ndarray, "H W 4"]],
    pts: Int[np.ndarray, " T"],
    time_base: Fraction,
    kind: Literal["prores", "webm"],
) -> None:
    """Encode straight RGBA frames at the times ``pts * time_base``, counted from the first.

    The file appears whole or not at all. Raises ValueError where there are no frames, or not one per time.
    """
    how, pictures = KINDS[kind], iter(frames)
    first = next(pictures, None)
    if first is None or len(pts) == 0:
        raise ValueError("expected at least one frame and one time")
    times = (np.asarray(pts, np.int64) - int(pts[0])).tolist()
    lengths = np.diff(times, append=2 * times[-1] - times[-2] if len(times) > 1 else 1).tolist()
    rate = 1 / (Fraction(int(np.median(lengths))) * time_base)  # what the file says, and how long its last frame lasts
    if kind == "webm":  # libvpx refuses coarse ticks, and the container rounds to milliseconds anyway
        times, lengths = ([round(time * time_base * 1000) for time in some] for some in (times, lengths))
        time_base = Fraction(1, 1000)
    with written_beside(path, how.container) as container:
        stream = container.add_stream(how.codec, rate=rate, options=how.options)
        assert isinstance(stream, VideoStream), "both codecs are video"
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = how.pixels
        stream.time_base = time_base
        codec = stream.codec_context
        codec.time_base, codec.thread_count = time_base, THREADS
        codec.colorspace, codec.color_range = Colorspace.ITU709, ColorRange.MPEG
        codec.color_primaries, codec.color_trc = ColorPrimaries.BT709, ColorTrc.BT709
        for picture, time, length in zip(chain([first], pictures), times, lengths, strict=True):
            frame = _frame(picture, how.pixels)
            frame.pts, frame.time_base, frame.duration = time, time_base, length
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _frame(picture: UInt8[np.ndarray, "H W 4"], pixels: str) -> av.VideoFrame:
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgba").reformat(
        format=pixels, dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG, interpolation="BICUBIC"
    )
    frame.color_primaries, frame.color_trc = ColorPrimaries.BT709, ColorTrc.BT709  # ProRes takes them from here
    return frame
