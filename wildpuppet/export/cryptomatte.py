"""Cryptomatte: which parts a pixel shows and how much of each, so that a compositor picks mattes by clicking.

Friedman and Jones, "Fully Automatic ID Mattes with Support for Motion Blur and Transparency" (2015), and the published
specification 1.2: a name's id is its MurmurHash3 (32 bits, seed 0) read as a float that is neither denormal nor
infinite; pixels list (id, coverage) pairs, most covering first, two pairs to an RGBA layer.
"""

import json
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float32

from wildpuppet.export.fields import PartFields

NAME = "CryptoObject"
LAYERS = 3
"""RGBA layers: two parts each. Six parts that show in one pixel is more than cartoons ask for."""


def murmur3(text: str) -> int:
    """Hash UTF-8 text by MurmurHash3_x86_32 with seed 0."""
    data, whole = text.encode(), 0xFFFFFFFF
    state = 0
    for start in range(0, len(data), 4):
        block = data[start : start + 4]
        mixed = int.from_bytes(block, "little") * 0xCC9E2D51 & whole
        mixed = (mixed << 15 | mixed >> 17) * 0x1B873593 & whole
        state ^= mixed
        if len(block) == 4:
            state = (state << 13 | state >> 19) & whole
            state = state * 5 + 0xE6546B64 & whole
    state ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        state = (state ^ state >> shift) * factor & whole
    return state


def id_of(name: str) -> np.float32:
    """Give a name's id: the hash's bits as a float, its exponent kept off 0 and 255."""
    bits = murmur3(name)
    if (bits >> 23) & 255 in (0, 255):
        bits ^= 1 << 23
    return np.uint32(bits).view(np.float32)


def metadata(names: Sequence[str]) -> dict[str, str]:
    """Give the header's entries: which layers hold the ids, and what names they stand for."""
    key = f"cryptomatte/{murmur3(NAME):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{int(id_of(name).view(np.uint32)):08x}" for name in names}
    return {
        f"{key}/name": NAME,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, separators=(",", ":")),
    }


def channels(
    parts: Sequence[PartFields], ids: Mapping[int, np.float32], size: tuple[int, int]
) -> dict[str, Float32[np.ndarray, "H W"]]:
    """Give the ranked pairs of a frame as channels CryptoObject00.R and so on. ``ids`` are by layer."""
    width, height = size
    ranked_ids = np.zeros((2 * LAYERS, height, width), np.float32)
    coverage = np.zeros((2 * LAYERS, height, width), np.float32)
    for part in parts:
        _insert(ranked_ids[:, *part.window], coverage[:, *part.window], part, ids[part.layer])
    named = {}
    for rank in range(2 * LAYERS):
        layer, pair = f"{NAME}{rank // 2:02d}", ("R", "G") if rank % 2 == 0 else ("B", "A")
        named[f"{layer}.{pair[0]}"], named[f"{layer}.{pair[1]}"] = ranked_ids[rank], coverage[rank]
    return named


def _insert(
    ids: Float32[np.ndarray, "R h w"], coverage: Float32[np.ndarray, "R h w"], part: PartFields, own: np.float32
) -> None:
    """Put a part into the ranking of its window, in place; what falls off the end is dropped."""
    new_id = np.where(part.seen > 0, own, np.float32(0)).astype(np.float32)
    new = np.where(part.seen > 0, part.seen, 0).astype(np.float32)
    for rank in range(len(ids)):
        is_more = new > coverage[rank]
        old_id, old = ids[rank][is_more].copy(), coverage[rank][is_more].copy()
        ids[rank][is_more], coverage[rank][is_more] = new_id[is_more], new[is_more]
        new_id[is_more], new[is_more] = old_id, old
