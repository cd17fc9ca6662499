"""Open a video file and decode its frames: what the frame table (``probe``) and the reader (``read``) share.

The frame's own pts is its name. Containers without presentation times (AVI, raw streams) are *counted*: their frames
are numbered in the order in which they decode. Rotation is the file's (decoders do not apply it), and colour follows
the file's tags; an untagged file counts as BT.709 from 720 rows upwards and as BT.601 below.
"""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.packet import Packet
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.reformatter import Colorspace
from av.video.stream import VideoStream
from jaxtyping import UInt8

from wildpuppet.errors import InputError

if TYPE_CHECKING:
    VideoPacket = Packet[VideoStream]
else:
    VideoPacket = Packet

COLORSPACE_UNSPECIFIED = 2
ROWS_OF_709 = 720
NO_TIMESTAMPS = 0x80
"""libavformat's AVFMT_NOTIMESTAMPS."""
NOT_VIDEO_FORMATS = frozenset({"tty", "concat", "hls", "dash"})
"""Text that FFmpeg would draw, and lists that name other files."""

# FFmpeg's messages through Python would deadlock with decoders that log on their own threads (PyAV issues 751, 909).
av.logging.set_level(None)


def open_video(path: Path, threads: int = 0) -> tuple[InputContainer, VideoStream]:
    """Open a video file; close the container when done.

    ``threads`` 1 decodes on one thread, which makes the concealment of damaged frames repeatable; 0 leaves their
    number to the decoder. Raises InputError, one clear line, for whatever is not a video file.
    """
    if not path.exists():
        raise InputError(f"{path}: expected a video file, found nothing there; check the path")
    if path.is_dir():
        raise InputError(f"{path}: expected a video file, found a folder; `wildpuppet fit` reads folders of drawings")
    try:
        container = av.open(f"file:{path}", options={"protocol_whitelist": "file"})
    except (av.error.FFmpegError, OSError) as error:
        reason = f"FFmpeg says: {error.strerror}" if error.strerror else "FFmpeg cannot read it"
        raise InputError(f"{path}: expected a video file ({reason}); convert it to MP4 or download it again") from None
    stream = _picture_stream(container)
    if stream is None:
        container.close()
        raise InputError(f"{path}: expected a video file, found no video stream in it; give a file with pictures")
    # Frames that are counted cannot show that one was lost, so there the number of threads must not matter either.
    is_single = threads == 1 or is_counted(container)
    stream.thread_type = "NONE" if is_single else "AUTO"
    stream.codec_context.thread_count = 1 if is_single else threads
    return container, stream


def _picture_stream(container: InputContainer) -> VideoStream | None:
    """Find the first video stream that is not a cover picture."""
    if container.format.name in NOT_VIDEO_FORMATS:
        return None
    covers = Disposition.attached_pic | Disposition.timed_thumbnails
    return next((s for s in container.streams.video if not s.disposition & covers and s.codec_context), None)


def is_counted(container: InputContainer) -> bool:
    """Tell whether the container has no presentation times, so that frames are numbered as they decode."""
    return container.format.name == "avi" or bool(container.format.flags & NO_TIMESTAMPS)


def is_shown(packet: VideoPacket) -> bool:
    """Tell whether a packet makes a frame: it is neither cut off by an edit list nor hidden (VP8)."""
    if packet.is_discard:
        return False
    return packet.stream.codec_context.name != "vp8" or bool(bytes(packet)[0] & 0x10)


def packets(container: InputContainer, stream: VideoStream) -> Iterator[VideoPacket]:
    """Yield the stream's packets; a file that breaks off ends there."""
    source = container.demux(stream)
    while True:
        try:
            packet = next(source)
        except (StopIteration, av.error.FFmpegError):
            return
        if packet.size:
            yield packet


def good_frames(stream: VideoStream, source: Iterable[VideoPacket]) -> Iterator[VideoFrame]:
    """Yield every frame of the packets that decodes, in presentation order, and empty the decoder at the end."""
    for packet in chain(source, [None]):
        try:
            frames = stream.decode(packet)
        except av.error.FFmpegError:
            continue
        yield from (frame for frame in frames if not frame.is_corrupt)


def quarter_turns(frame: VideoFrame) -> int:
    """Counter-clockwise quarter turns (0 to 3) that put the frame upright."""
    return round(frame.rotation / 90) % 4


def upright_size(frame: VideoFrame) -> tuple[int, int]:
    """Size (W, H) of the frame once it is upright."""
    return (frame.height, frame.width) if quarter_turns(frame) % 2 else (frame.width, frame.height)


def rgb_of(frame: VideoFrame, size: tuple[int, int], interpolation: str = "BILINEAR") -> UInt8[np.ndarray, "H W 3"]:
    """Convert a frame to upright RGB of ``size`` (W, H).

    A frame of another size (streams may change) is scaled; transparent ones (GIF, ProRes 4444) are laid over white.
    """
    turns = quarter_turns(frame)
    width, height = size if turns % 2 == 0 else size[::-1]
    colorspace = frame.colorspace
    if colorspace == COLORSPACE_UNSPECIFIED:
        colorspace = Colorspace.ITU709 if frame.height >= ROWS_OF_709 else Colorspace.ITU601
    has_alpha = any(component.is_alpha for component in frame.format.components)
    picture = frame.reformat(
        width=width,
        height=height,
        format="rgba" if has_alpha else "rgb24",
        src_colorspace=None if frame.format.is_rgb else colorspace,
        interpolation=interpolation,
    ).to_ndarray()
    if has_alpha:
        picture = over_white(picture)
    return np.ascontiguousarray(np.rot90(picture, turns)) if turns else picture


def over_white(rgba: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 3"]:
    """Lay straight RGBA over white."""
    alpha = rgba[..., 3:].astype(np.uint16)
    mixed = rgba[..., :3] * alpha + 255 * (255 - alpha)
    return ((mixed + 127) // 255).astype(np.uint8)
