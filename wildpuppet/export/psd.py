"""A layered PSD: one layer per part under its name, where it lies, with its own straight alpha.

Photoshop's published file format, 8 bits per channel, rows packed by PackBits; names are written in Unicode beside the
old Mac Roman field. The merged picture that viewers show lies over white with its alpha beside it, as Photoshop does.
"""

import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.export.sprites import Sprite, merged, over_white, picture_of
from wildpuppet.machine import Progress

LARGEST_SIDE = 30000
"""Photoshop's limit for PSD."""
LONGEST = 128
"""Bytes that one PackBits count can stand for."""
SHORTEST_RUN = 3
"""Equal bytes from which a run is shorter than writing them out."""
RGB_MODE = 3
PACKED = 1
CHANNELS = ((-1, 3), (0, 0), (1, 1), (2, 2))
"""PSD's channel number and ours: transparency first, as Photoshop writes it."""


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.psd: one layer per part, at rest or in the frame that ``options`` names."""
    size, sprites, manifest = picture_of(animation, options)
    write_psd(folder / f"{file_names([animation.name])[0]}.psd", size, sprites)
    progress(1, 1)
    return manifest


def write_psd(path: Path, size: tuple[int, int], sprites: Sequence[Sprite]) -> None:
    """Write a document of ``size`` (W, H) with ``sprites`` back to front; they may reach beyond the canvas.

    Raises InputError for a canvas beyond 30000 pixels.
    """
    if max(size) > LARGEST_SIDE:
        raise InputError(f"PSD holds at most {LARGEST_SIDE} x {LARGEST_SIDE} pixels, found {size}; export ORA instead")
    layers = _layers(sprites)
    whole = merged(size, sprites)
    shown = np.dstack([over_white(whole), whole[..., 3]])
    rows = [_packed_rows(shown[..., channel]) for channel in range(4)]
    with path.open("wb") as file:
        file.write(struct.pack(">4sH6xHIIHH", b"8BPS", 1, 4, size[1], size[0], 8, RGB_MODE))
        file.write(struct.pack(">II", 0, 0))  # no palette, no resources
        file.write(struct.pack(">II", len(layers) + 8, len(layers)) + layers + struct.pack(">I", 0))
        file.write(struct.pack(">H", PACKED))
        file.write(b"".join(_counts(packed) for packed in rows))
        file.write(b"".join(row for packed in rows for row in packed))


def pack_bits(row: bytes) -> bytes:
    """Encode bytes by PackBits: runs of equal bytes, and the rest as it is."""
    values = np.frombuffer(row, np.uint8)
    if not len(values):
        return b""
    starts = np.flatnonzero(np.diff(values, prepend=values[0] ^ 1))
    lengths = np.diff(starts, append=len(values))
    is_long = lengths >= SHORTEST_RUN
    packed, written = BytesIO(), 0
    for start, length in zip(starts[is_long].tolist(), lengths[is_long].tolist(), strict=True):
        _literal(packed, row[written:start])
        _run(packed, row[start], length)
        written = start + length
    _literal(packed, row[written:])
    return packed.getvalue()


def _literal(packed: BytesIO, values: bytes) -> None:
    for first in range(0, len(values), LONGEST):
        piece = values[first : first + LONGEST]
        packed.write(bytes([len(piece) - 1]) + piece)


def _run(packed: BytesIO, value: int, length: int) -> None:
    while length:
        piece = min(length, LONGEST)
        packed.write(bytes([(257 - piece) % 256, value]))
        length -= piece


def _layers(sprites: Sequence[Sprite]) -> bytes:
    records, pixels = BytesIO(), BytesIO()
    for sprite in sprites:
        channels = [_channel(sprite.rgba[..., ours]) for _, ours in CHANNELS]
        records.write(_record(sprite, [len(channel) for channel in channels]))
        pixels.write(b"".join(channels))
    # a count below zero says that the merged picture has its transparency as a fourth channel
    block = struct.pack(">h", -len(sprites)) + records.getvalue() + pixels.getvalue()
    return block + b"\0" * (-len(block) % 4)


def _record(sprite: Sprite, lengths: Sequence[int]) -> bytes:
    height, width = sprite.rgba.shape[:2]
    head = struct.pack(">4iH", sprite.top, sprite.left, sprite.top + height, sprite.left + width, len(CHANNELS))
    sizes = b"".join(struct.pack(">hI", number, size) for (number, _), size in zip(CHANNELS, lengths, strict=True))
    look = struct.pack(">4s4sBBBx", b"8BIM", b"norm", 255, 0, 0)
    extra = struct.pack(">II", 0, 0) + _pascal(sprite.name) + _unicode(sprite.name)
    return head + sizes + look + struct.pack(">I", len(extra)) + extra


def _pascal(name: str) -> bytes:
    text = name.encode("mac_roman", "replace")[:255]
    whole = bytes([len(text)]) + text
    return whole + b"\0" * (-len(whole) % 4)


def _unicode(name: str) -> bytes:
    text = name.encode("utf-16-be")
    body = struct.pack(">I", len(text) // 2) + text
    body += b"\0" * (-len(body) % 4)
    return struct.pack(">4s4sI", b"8BIM", b"luni", len(body)) + body


def _channel(values: UInt8[np.ndarray, "h w"]) -> bytes:
    rows = _packed_rows(values)
    block = struct.pack(">H", PACKED) + _counts(rows) + b"".join(rows)
    return block + b"\0" * (len(block) % 2)  # even, for readers that walk from channel to channel


def _packed_rows(values: UInt8[np.ndarray, "h w"]) -> list[bytes]:
    return [pack_bits(row.tobytes()) for row in values]


def _counts(rows: Sequence[bytes]) -> bytes:
    return np.array([len(row) for row in rows], ">u2").tobytes()
