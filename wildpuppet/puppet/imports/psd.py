"""Layered Photoshop files (PSD, PSB), as Photoshop, Clip Studio, Krita, GIMP and the layer-splitting tools write them.

Every visible layer is a part; PSD lists them back to front. Masks and opacity go into the part's alpha. Clipped layers
are painted onto the layer they are clipped to; effects and vector masks are painted as far as psd-tools can. What
cannot be kept apart (blend modes, adjustment layers) is told in the notes. psd-tools: MIT, reads all colour modes.
"""

import logging
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.folder import MOST_PIXELS
from wildpuppet.puppet.imports.limits import (
    MOST_BYTES,
    MOST_DEPTH,
    MOST_TOTAL_PIXELS,
    Rgba,
    needed,
    require_canvas,
)
from wildpuppet.puppet.imports.result import Imported, Layer, assembled, merged, without_backdrop

SIGNATURE = b"8BPS"
_MOST_MEMORY = 2**32
"""Bytes that psd-tools may take for one picture at its peak."""
_UNREADABLE = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, OSError, RecursionError, TypeError,
    ValueError, struct.error, UserWarning,
)  # fmt: skip
"""What psd-tools raises on files that are broken; a channel that cannot be unpacked is a UserWarning."""


def read_psd(path: Path, *, merge_groups: bool = False) -> Imported:
    """Read a layered PSD or PSB file; with ``merge_groups`` the layers of a group become one part.

    Raises:
        PuppetError: no layers, too big, broken, or psd-tools is not installed.
    """
    where = str(path)
    _look_at_header(path)
    psd_tools = needed("psd_tools", where)
    with _refusing(where):
        document = psd_tools.PSDImage.open(path, max_alloc_bytes=_MOST_MEMORY)
    with _refusing(where):
        found = list(_leaves(document, (), where))
        require_canvas(document.size, len(found), where)
        _look_at_layers(found, where)
        notes: list[str] = []
        layers = [layer for leaf, groups in found if (layer := _layer(leaf, groups, document.size, notes))]
        canvas = (int(document.width), int(document.height))
    if not found:
        raise PuppetError(f"{where}: holds one flat picture; expected one layer per part")
    kept = without_backdrop(layers, canvas, notes)
    return assembled(canvas, merged(kept) if merge_groups else kept, notes, where)


def _look_at_header(path: Path) -> None:
    """Refuse by the header alone what is no PSD or too big."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(26)
    except OSError as error:
        raise PuppetError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(head) < 26 or head[:4] != SIGNATURE:
        raise PuppetError(f"{path}: not a Photoshop file; expected one that begins with 8BPS")
    if size > MOST_BYTES:
        raise PuppetError(f"{path}: {size / 2**20:.0f} MiB is too large; at most {MOST_BYTES / 2**20:.0f} MiB")
    height, width = struct.unpack(">II", head[14:22])
    require_canvas((width, height), 1, str(path))


@contextmanager
def _refusing(where: str) -> Iterator[None]:
    """Turn whatever a broken file makes psd-tools raise into one line; what it logs besides is not for the person."""
    logger = logging.getLogger("psd_tools")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            yield
    except _UNREADABLE as error:
        reason = " ".join(str(error).split())[:160]
        raise PuppetError(f"{where}: cannot be read as a Photoshop file ({type(error).__name__}: {reason})") from None
    finally:
        logger.setLevel(before)


def _leaves(group: Any, groups: tuple[Any, ...], where: str) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """List the layers that are no groups, back to front, each with the groups around it, outermost first."""
    if len(groups) > MOST_DEPTH:
        raise PuppetError(f"{where}: groups are nested more than {MOST_DEPTH} deep; flatten some")
    for layer in group:
        if layer.is_group():
            yield from _leaves(layer, (*groups, layer), where)
        else:
            yield layer, groups


def _look_at_layers(found: list[tuple[Any, tuple[Any, ...]]], where: str) -> None:
    total = 0
    for layer, _ in found:
        pixels = max(layer.width, 0) * max(layer.height, 0)
        total += pixels
        if pixels > MOST_PIXELS or total > MOST_TOTAL_PIXELS:
            raise PuppetError(f"{where}: layer {_name(layer)!r} is too big ({layer.width} x {layer.height}); crop it")


def _layer(leaf: Any, groups: tuple[Any, ...], canvas: tuple[int, int], notes: list[str]) -> Layer | None:
    """Turn one layer into pixels; None for what is not a part of its own."""
    name = _name(leaf)
    if not leaf.is_visible():
        notes.append(f"{name!r} is hidden and left out")
        return None
    if leaf.clipping and not _lies_on_group(leaf):
        notes.append(f"{name!r} is painted onto the layer that it is clipped to")
        return None
    if leaf.kind not in ("pixel", "smartobject", "type", "shape") and not leaf.kind.endswith("fill"):
        notes.append(f"{name!r} ({leaf.kind}) changes the colours below it and is left out")
        return None
    rgba, corner = _pixels(leaf, canvas, notes)
    if rgba is None:
        notes.append(f"{name!r} is left out: it holds no pixels")
        return None
    for group in groups:
        _fade(rgba, corner, group, notes)
    mode = leaf.blend_mode.name.lower()
    if mode != "normal":
        notes.append(f"{name!r} was blended by {mode}; its plain colours are taken")
    return Layer(name, rgba, corner, tuple(_name(group) for group in groups))


def _lies_on_group(leaf: Any) -> bool:
    below = leaf.previous_sibling()
    while below is not None and below.clipping:
        below = below.previous_sibling()
    return below is None or bool(below.is_group())


def _pixels(leaf: Any, canvas: tuple[int, int], notes: list[str]) -> tuple[Rgba | None, tuple[int, int]]:
    """Give a layer's picture with its own mask and opacity in alpha, and where its first pixel lies."""
    reasons = [
        word
        for word, holds in (
            ("layers clipped to it", leaf.has_clip_layers(visible=True)),
            ("a vector mask or shape", leaf.has_vector_mask() or not leaf.has_pixels()),
            ("effects", leaf.has_effects()),
        )
        if holds
    ]
    if reasons:
        image = leaf.composite(viewport=(0, 0, *canvas))
        if image is None:
            return None, (0, 0)
        if reasons != ["layers clipped to it"]:
            notes.append(f"{_name(leaf)!r} has {' and '.join(reasons)}, painted in as far as psd-tools can; look at it")
        return np.array(image.convert("RGBA")), (0, 0)
    image = leaf.topil()
    if image is None:
        return None, (0, 0)
    rgba = np.array(image.convert("RGBA"))
    corner = (int(leaf.left), int(leaf.top))
    _fade(rgba, corner, leaf, notes)
    rgba[..., 3] = np.rint(rgba[..., 3] * (leaf.fill_opacity / 255.0))
    return rgba, corner


def _fade(rgba: Rgba, corner: tuple[int, int], layer: Any, notes: list[str]) -> None:
    """Multiply a layer's or a group's opacity and pixel mask into alpha."""
    share = np.full(rgba.shape[:2], layer.opacity / 255.0)
    mask = layer.mask if layer.has_mask() else None
    if mask is not None and not mask.disabled:
        share *= _mask_under(mask, corner, rgba.shape[:2]) / 255.0
    if layer.is_group() and (layer.has_effects() or layer.has_vector_mask()):
        notes.append(f"effects or vector mask of the group {_name(layer)!r} are left out")
    rgba[..., 3] = np.rint(rgba[..., 3] * share)


def _mask_under(mask: Any, corner: tuple[int, int], shape: tuple[int, ...]) -> np.ndarray:
    """Give the mask's value at each pixel of a picture; beyond the mask lies its background value."""
    under = np.full(shape, float(mask.background_color))
    image = mask.topil()
    if image is None:
        return under
    values = np.asarray(image.convert("L"), np.float64)
    x, y = int(mask.left) - corner[0], int(mask.top) - corner[1]
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + values.shape[1], shape[1]), min(y + values.shape[0], shape[0])
    if right > left and bottom > top:
        under[top:bottom, left:right] = values[top - y : bottom - y, left - x : right - x]
    return under


def _name(layer: Any) -> str:
    """Give a layer's name; Krita ends it with a NUL."""
    return str(layer.name).rstrip("\0").strip()
