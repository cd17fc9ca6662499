"""Read a clip's frame table: exact sorted times, upright size, shots, frames that do not decode.

Packets are listed first, without decoding: they name every frame by its pts. One decoding pass then finds the frames
that never come out, and the shots. No frame rate is trusted: a file's average rate means nothing when frames last
differently long.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from jaxtyping import Float

from wildpuppet.errors import InputError
from wildpuppet.machine import Machine, silent
from wildpuppet.settings import ProbeSettings
from wildpuppet.types import Clip
from wildpuppet.video.decode import (
    good_frames,
    is_counted,
    is_shown,
    open_video,
    packets,
    rgb_of,
    upright_size,
)
from wildpuppet.video.shots import ChangeMeter, shot_starts

THUMBNAIL = 64
"""Larger side of the pictures in which cuts are looked for."""
FALLBACK_RATE = Fraction(24)


@dataclass
class _Decoded:
    """What the decoding pass saw: the times that came out, in order, and their changes."""

    size: tuple[int, int] = (0, 0)
    times: list[int] = field(default_factory=list)
    changes: list[Float[np.ndarray, " lags"]] = field(default_factory=list)


def probe(path: Path, settings: ProbeSettings, machine: Machine) -> Clip:
    """Read the frame table, the shots and the digest of a video file.

    A frame that does not decode stays in the table and is listed in ``bad_frames``, unless it comes before the first
    one that does. In containers without presentation times (AVI, raw streams) frames are numbered as they decode,
    and only those that decode are. Raises InputError when there is no such file, or no video in it.
    """
    container, stream = open_video(path)
    with container:
        listed = sorted({p.pts for p in packets(container, stream) if p.pts is not None and is_shown(p)})
        counted = is_counted(container)
        time_base = _time_base(stream, counted)
    decoded = _decode(path, settings, machine, len(listed), threads=0)
    if decoded.times != (list(range(len(listed))) if counted else listed):
        decoded = _decode(path, settings, replace(machine, progress=silent), len(listed), threads=1)
    if not decoded.times:
        raise InputError(f"{path}: expected frames, found none that decode; convert it to MP4 or download it again")
    return _clip(path, [] if counted else listed, decoded, settings, time_base)


def _decode(path: Path, settings: ProbeSettings, machine: Machine, total: int, threads: int) -> _Decoded:
    """Decode the whole file once; only thumbnails are kept, and only a few."""
    container, stream = open_video(path, threads)
    decoded, meter = _Decoded(), ChangeMeter(settings.least_shot_frames)
    with container:
        for time, frame in _timed_frames(container, stream):
            if not decoded.times:
                decoded.size = upright_size(frame)
            decoded.times.append(time)
            decoded.changes.append(meter.measure(rgb_of(frame, _thumbnail_size(decoded.size), "AREA")))
            machine.progress(min(len(decoded.times), total), total)
    machine.progress(total, total)
    return decoded


def _timed_frames(container: InputContainer, stream: VideoStream) -> Iterator[tuple[int, VideoFrame]]:
    counted = is_counted(container)
    for number, frame in enumerate(good_frames(stream, packets(container, stream))):
        if counted:
            yield number, frame
        elif frame.pts is not None:
            yield frame.pts, frame


def _thumbnail_size(size: tuple[int, int]) -> tuple[int, int]:
    scale = min(1.0, THUMBNAIL / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _time_base(stream: VideoStream, counted: bool) -> Fraction:
    if counted or stream.time_base is None:
        return 1 / (stream.average_rate or FALLBACK_RATE)
    return stream.time_base


def _clip(path: Path, listed: list[int], decoded: _Decoded, settings: ProbeSettings, time_base: Fraction) -> Clip:
    pts = np.array(sorted(set(listed) | set(decoded.times)), np.int64)
    pts = pts[pts >= min(decoded.times)]
    row_of = {time: row for row, time in enumerate(decoded.times)}
    changes = np.zeros((len(pts), settings.least_shot_frames), np.float32)
    bad = []
    for frame, time in enumerate(pts.tolist()):
        if time in row_of:
            changes[frame] = decoded.changes[row_of[time]]
        else:
            bad.append(frame)
    return Clip(
        path=path,
        digest=digest_of(path),
        size=decoded.size,
        pts=pts,
        time_base=time_base,
        shot_starts=shot_starts(changes, settings),
        bad_frames=tuple(bad),
    )


def digest_of(path: Path) -> str:
    """BLAKE2b of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=32)).hexdigest()
