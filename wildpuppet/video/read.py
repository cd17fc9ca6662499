"""Read a clip's frames by number: frame i is always the picture that decoding the whole file gives for frame i.

Seeking lands on a key frame that is shown no later than the frame wanted, and frames are dropped until their pts is the
one that the frame table names. Where a seek does not lead there (open groups of pictures, files without an index), the
file is decoded from its start.
"""

from collections.abc import Generator, Iterator
from contextlib import closing
from itertools import chain
from types import TracebackType

import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from jaxtyping import UInt8

from wildpuppet.errors import InputError
from wildpuppet.types import Clip
from wildpuppet.video.decode import VideoPacket, good_frames, is_counted, open_video, packets, rgb_of

READ_ON = 24
"""``frame`` decodes on rather than seeking when the frame wanted is at most so many frames ahead."""


class FrameReader:
    """Frames of a clip as (H, W, 3) uint8 RGB, upright; use it as a context manager.

    A bad frame repeats the good one before it. Memory does not grow with the number of frames read. Pictures may be
    shared between frames: copy one before writing into it. ``threads`` bounds the decoder.
    """

    def __init__(self, clip: Clip, threads: int = 0) -> None:
        self._clip = clip
        self._threads = 1 if clip.bad_frames else threads
        self._index_of = {time: index for index, time in enumerate(clip.pts.tolist())}
        is_good = np.ones(clip.num_frames, bool)
        is_good[list(clip.bad_frames)] = False
        self._shown = np.maximum.accumulate(np.where(is_good, np.arange(clip.num_frames), 0))
        self._run: Iterator[tuple[int, UInt8[np.ndarray, "H W 3"]]] = iter(())
        self._last: tuple[int, UInt8[np.ndarray, "H W 3"]] | None = None

    def __enter__(self) -> "FrameReader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._run, self._last = iter(()), None

    def frames(self, start: int = 0, end: int | None = None) -> Iterator[tuple[int, UInt8[np.ndarray, "H W 3"]]]:
        """Yield (number, picture) of frames ``start`` to ``end``, which is not included; several may run at once.

        Raises InputError for a range outside the clip, or when the file is no longer the one that was probed.
        """
        end = self._clip.num_frames if end is None else end
        if not 0 <= start <= end <= self._clip.num_frames:
            raise InputError(
                f"{self._clip.path}: expected frames from 0 to {self._clip.num_frames}, found {start} to {end}; "
                "choose a range inside the clip"
            )
        return self._pictures(start, end)

    def frame(self, number: int) -> UInt8[np.ndarray, "H W 3"]:
        """Read one frame; going forwards in small steps is cheap, a jump costs a seek."""
        if self._last is None or not self._last[0] <= number <= self._last[0] + READ_ON:
            self._run, self._last = self.frames(number, None if number < self._clip.num_frames else number + 1), None
        while self._last is None or self._last[0] < number:
            self._last = next(self._run)
        return self._last[1]

    def _pictures(self, start: int, end: int) -> Iterator[tuple[int, UInt8[np.ndarray, "H W 3"]]]:
        if start == end:
            return
        held, decoded = -1, self._good_from(int(self._shown[start]))
        try:
            for number in range(start, end):
                wanted = int(self._shown[number])
                if wanted != held:
                    held, frame = next(decoded, (-1, None))
                    if held != wanted or frame is None:  # a decoder of several threads lost it in a damaged file
                        decoded.close()
                        decoded = self._good_from(wanted)
                        held, frame = next(decoded)
                    picture = rgb_of(frame, self._clip.size)
                yield number, picture
        finally:
            decoded.close()

    def _good_from(self, first: int) -> Generator[tuple[int, VideoFrame], None, None]:
        """Yield (number, frame) of good frames from ``first``, which is good, by the nearest way that leads there.

        What hides damage depends on the frames decoded before it, so nothing is skipped in a damaged file; one that
        merely breaks off is not damaged.
        """
        bad = self._clip.bad_frames
        is_damaged = bool(bad) and min(bad) < self._clip.num_frames - len(bad)
        near = [] if is_damaged else [(first, self._threads), (max(0, first - 4 * READ_ON), self._threads)]
        for target, threads in [*near, (0, 1)]:
            with closing(self._decode_from(target, threads)) as run:
                head = next((found for found in run if found[0] >= first), None)
                if head is not None and head[0] == first:
                    yield head
                    yield from run
                    return
        raise self._changed(first)

    def _decode_from(self, target: int, threads: int) -> Generator[tuple[int, VideoFrame], None, None]:
        """Decode from the key frame at or before ``target``, nothing when there is none; 0 is the file's start."""
        container, stream = open_video(self._clip.path, threads)
        with container:
            counted = is_counted(container)
            if target == 0:
                source = packets(container, stream)
            elif counted:
                return
            else:
                source = self._packets_from(container, stream, int(self._clip.pts[target]))
            last = -1
            for count, frame in enumerate(good_frames(stream, source)):
                index = count if counted else self._index_of.get(frame.pts, -1)
                if last < index < len(self._shown) and self._shown[index] == index:
                    last = index
                    yield index, frame

    def _packets_from(self, container: InputContainer, stream: VideoStream, time: int) -> Iterator[VideoPacket]:
        try:
            container.seek(time, stream=stream, backward=True)
        except av.error.FFmpegError:
            return
        source = packets(container, stream)
        for packet in source:
            if packet.is_keyframe and packet.pts is not None:
                if packet.pts <= time:
                    yield from chain([packet], source)
                return

    def _changed(self, number: int) -> InputError:
        return InputError(
            f"{self._clip.path}: expected frame {number} as it was when the file was probed, found none that decodes; "
            "the file has changed: run again"
        )
