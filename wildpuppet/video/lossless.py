"""Keep RGBA images in a video, bit for bit: FFV1 in Matroska, every frame a key frame.

Image i is shown at i / 25 s, which Matroska's milliseconds hold exactly, so that a seek to any image is exact. The
colour under alpha 0 is kept too.
"""

import os
from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from jaxtyping import UInt8

from wildpuppet.errors import StoreError
from wildpuppet.types import Images
from wildpuppet.video.encode import written_beside

TICKS = 40
"""Milliseconds from one image to the next."""
AT_ONCE = 16
"""Images that are read at once when a stack of them is written."""


def write_lossless(path: Path, images: Images | Iterable[UInt8[np.ndarray, "H W 4"]]) -> None:
    """Write a stack, or any iterable, of (H, W, 4) uint8 images; the file appears whole or not at all.

    Writing the same images again gives the same bytes. Raises ValueError where there are no images or sizes differ.
    """
    pictures = one_by_one(images)
    first = next(pictures, None)
    if first is None:
        raise ValueError("expected at least one image")
    with written_beside(path, "matroska") as container:
        stream = container.add_stream("ffv1", rate=25, options={"level": "3", "slices": "4", "slicecrc": "1", "g": "1"})
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "bgra"
        stream.codec_context.time_base = Fraction(1, 1000)
        for number, picture in enumerate(chain([first], pictures)):
            if picture.shape != first.shape or picture.dtype != np.uint8:
                raise ValueError(f"expected uint8 {first.shape}, found {picture.dtype} {picture.shape}")
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[..., [2, 1, 0, 3]]), format="bgra")
            frame.pts, frame.time_base, frame.duration = TICKS * number, Fraction(1, 1000), TICKS
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def one_by_one(images: Images | Iterable[UInt8[np.ndarray, "H W 4"]]) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
    """Yield the images of a stack, which is read a few at a time, or of any iterable."""
    if isinstance(images, Iterable):
        yield from images
        return
    for start in range(0, len(images), AT_ONCE):
        yield from images[start : start + AT_ONCE]


class VideoImages:
    """The images of a lossless video as a stack that is read a slice at a time; one image at a time when iterated.

    The file is opened at the first read, and again in a forked process. Raises StoreError where it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._container: InputContainer | None = None
        self._frames: Iterator[VideoFrame] = iter(())
        self._process = 0
        self._next = 0
        self._length = -1

    def __reduce__(self) -> tuple[type["VideoImages"], tuple[Path]]:
        return VideoImages, (self._path,)

    def __len__(self) -> int:
        if self._length < 0:
            # Matroska's duration, in microseconds, is the end of the last image.
            self._length = round((self._opened().duration or 0) / (1000 * TICKS))
        return self._length

    def __iter__(self) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
        for start in range(0, len(self), AT_ONCE):
            yield from self[start : start + AT_ONCE]

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        numbers = range(*index.indices(len(self)))
        if not numbers:
            codec = self._opened().streams.video[0].codec_context
            return np.zeros((0, codec.height, codec.width, 4), np.uint8)
        rising = numbers if numbers.step > 0 else numbers[::-1]
        images = np.stack([self._image(number) for number in rising])
        return images if numbers.step > 0 else images[::-1]

    def _image(self, number: int) -> UInt8[np.ndarray, "H W 4"]:
        container = self._opened()
        try:
            if number != self._next:
                container.seek(TICKS * number, stream=container.streams.video[0])
                self._frames = container.decode(video=0)
            frame = next(frame for frame in self._frames if frame.pts == TICKS * number)
        except (av.error.FFmpegError, StopIteration):
            self._next = -1
            raise StoreError(f"{self._path}: image {number} cannot be read; clear the store and run again") from None
        self._next = number + 1
        return np.ascontiguousarray(frame.to_ndarray(format="bgra")[..., [2, 1, 0, 3]])

    def _opened(self) -> InputContainer:
        if self._container is None or self._process != os.getpid():
            try:
                self._container = av.open(f"file:{self._path}")
                # A decoder with threads of its own could not be let go in a forked process.
                self._container.streams.video[0].codec_context.thread_count = 1
            except (av.error.FFmpegError, OSError, IndexError):
                raise StoreError(f"{self._path}: expected a lossless video; clear the store and run again") from None
            self._process, self._next = os.getpid(), 0
            self._frames = self._container.decode(video=0)
        return self._container
