"""OpenRaster (ORA), as Krita, MyPaint, GIMP, Pinta and Drawpile write it: a zip of PNGs and a ``stack.xml``.

``stack.xml`` lists layers front to back, in nested stacks; the offsets of stacks add up. Opacity goes into alpha;
blend modes are told in the notes.
"""

import io
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import (
    MOST_DEPTH,
    MOST_PARTS,
    MOST_TEXT,
    MOST_TOTAL_PIXELS,
    number,
    read_bytes,
    read_picture,
    read_xml,
    require_canvas,
)
from wildpuppet.puppet.imports.result import Imported, Layer, assembled, merged, without_backdrop

MIMETYPE = b"image/openraster"
_NORMAL = ("", "svg:src-over")


def read_ora(path: Path, *, merge_groups: bool = False) -> Imported:
    """Read an OpenRaster file; with ``merge_groups`` the layers of a group become one part.

    Raises:
        PuppetError: not OpenRaster, broken, too big when unpacked.
    """
    where = str(path)
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path))) as archive:
            return _read_archive(archive, where, merge_groups)
    except (zipfile.BadZipFile, zlib.error, RuntimeError, ValueError, EOFError, OSError) as error:
        raise PuppetError(f"{where}: the archive is broken: {' '.join(str(error).split())}") from None


def _read_archive(archive: zipfile.ZipFile, where: str, merge_groups: bool) -> Imported:
    root = read_xml(_member(archive, "stack.xml", MOST_TEXT, where), f"{where}: stack.xml")
    stack = root.find("stack")
    if root.tag != "image" or stack is None:
        raise PuppetError(f"{where}: stack.xml holds no image with a stack; is this an OpenRaster file?")
    canvas = (int(number(root.get("w"), f"{where}: image w")), int(number(root.get("h"), f"{where}: image h")))
    found = list(_layers(stack, _Place(), (), where))
    require_canvas(canvas, len(found), where)
    notes: list[str] = []
    if any(number(each.get(axis) or "0", where) for each in stack.iter("stack") for axis in ("x", "y")):
        notes.append("stacks have offsets: they are added to their layers', as the specification asks (Krita does not)")
    layers: list[Layer] = []
    total = 0
    for element, place, groups in reversed(found):
        name = element.get("name") or Path(element.get("src") or "layer").stem
        if not place.is_shown:
            notes.append(f"{name!r} is hidden and left out")
            continue
        mode = element.get("composite-op") or ""
        if mode not in _NORMAL:
            notes.append(f"{name!r} was blended by {mode}; its plain colours are taken")
        source = element.get("src") or ""
        if not source.lower().endswith(".png"):
            notes.append(f"{name!r} ({source or 'without a picture'}) is no PNG and left out")
            continue
        rgba = read_picture(_member(archive, source, MOST_TEXT * 4, where), f"{where}: {source}", ("PNG",))
        total += rgba.shape[0] * rgba.shape[1]
        if total > MOST_TOTAL_PIXELS:
            raise PuppetError(f"{where}: its layers unpack to too many pixels; scale the picture down")
        rgba[..., 3] = np.rint(rgba[..., 3] * place.opacity)
        layers.append(Layer(name, rgba, place.corner, groups))
    kept = without_backdrop(layers, canvas, notes)
    return assembled(canvas, merged(kept) if merge_groups else kept, notes, where)


@dataclass(frozen=True)
class _Place:
    """Where and how much an element shows, as all stacks around it and its own attributes make it."""

    corner: tuple[int, int] = (0, 0)
    opacity: float = 1.0
    is_shown: bool = True

    def of(self, element: Element, where: str) -> "_Place":
        """Add an element's own attributes."""
        name = f"{where}: {(element.get('name') or element.tag)!r}"
        x, y = (int(number(element.get(axis) or "0", f"{name} {axis}")) for axis in ("x", "y"))
        share = min(max(number(element.get("opacity") or "1", f"{name} opacity"), 0.0), 1.0)
        is_shown = self.is_shown and element.get("visibility") != "hidden"
        return _Place((self.corner[0] + x, self.corner[1] + y), self.opacity * share, is_shown)


def _layers(
    stack: Element, around: _Place, groups: tuple[str, ...], where: str
) -> Iterator[tuple[Element, _Place, tuple[str, ...]]]:
    """List the layers front to back, each with its place and the names of the stacks around it."""
    if len(groups) > MOST_DEPTH:
        raise PuppetError(f"{where}: stacks are nested more than {MOST_DEPTH} deep; flatten some")
    if len(stack) > MOST_PARTS:
        raise PuppetError(f"{where}: {len(stack)} layers in one stack; at most {MOST_PARTS}")
    here = around.of(stack, where)
    for element in stack:
        if element.tag == "stack":
            yield from _layers(element, here, (*groups, element.get("name") or "group"), where)
        elif element.tag == "layer":
            yield element, here.of(element, where), groups


def _member(archive: zipfile.ZipFile, name: str, most: int, where: str) -> bytes:
    """Unpack one file of the archive, at most so many bytes; the archive's own word on its size is not believed."""
    try:
        info = archive.getinfo(name)
    except KeyError:
        raise PuppetError(f"{where}: {name} is missing in the archive; is this an OpenRaster file?") from None
    if info.file_size > most:
        raise PuppetError(f"{where}: {name} unpacks to {info.file_size / 2**20:.0f} MiB; that is too much")
    with archive.open(info) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise PuppetError(f"{where}: {name} unpacks to more than {most / 2**20:.0f} MiB; that is too much")
    return data
