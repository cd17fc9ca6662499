"""What a person edited: a folder of part pictures, a layered PSD or ORA, or one flat picture."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from wildpuppet.errors import InputError, PuppetError
from wildpuppet.export.naming import file_names
from wildpuppet.paint.flat import edited_flat
from wildpuppet.paint.texture import Edit, Picture, Pictures, canvas_pictures, differs, edited
from wildpuppet.puppet.folder import read_cutout
from wildpuppet.puppet.imports import ora, psd
from wildpuppet.puppet.imports.limits import open_picture, read_picture
from wildpuppet.puppet.imports.result import own_name
from wildpuppet.types import CutOut, Puppet

PUPPET_FILE = "puppet.json"


class Origin(NamedTuple):
    """What the edited pictures may be copies of, beside the texture itself.

    ``cutout`` is the puppet folder that the run was given; ``frame`` reads the frame that the puppet was drawn from.
    """

    cutout: CutOut | None = None
    frame: Callable[[], UInt8[np.ndarray, "H W 3"] | None] = lambda: None


def read_edit(path: Path, puppet: Puppet, origin: Origin | None = None) -> Edit:
    """Find what differs between a person's pictures and the puppet's own.

    Raises InputError for nothing there, pictures of another size, names of no part, or where nothing differs;
    PuppetError for files that cannot be read.
    """
    origin = origin or Origin()
    if path.is_dir():
        edit = _of_parts(path, puppet, origin, _folder(path, puppet), ())
    elif path.is_file():
        edit = _of_file(path, puppet, origin)
    else:
        raise InputError(f"--texture {path}: expected a folder of part pictures, a PSD, ORA or PNG, found nothing")
    if not edit.parts:
        lost = f" ({'; '.join(edit.notes)})" if edit.notes else ""
        raise InputError(f"--texture {path}: nothing differs from the puppet's own texture{lost}; paint on it first")
    return edit


def _of_file(path: Path, puppet: Puppet, origin: Origin) -> Edit:
    with path.open("rb") as file:
        head = file.read(200)
    if head.startswith(psd.SIGNATURE) or ora.MIMETYPE in head:
        reader = psd.read_psd if head.startswith(psd.SIGNATURE) else ora.read_ora
        read = reader(path)
        _require_size(path, read.cutout.canvas, puppet.canvas)
        pictures = _named(path, {part.name: part.rgba for part in read.cutout.parts}, puppet)
        missing = [name for name in puppet.names if name not in pictures]
        notes = (f"no layer for {', '.join(missing)}: unchanged",) if missing else ()
        return _of_parts(path, puppet, origin, pictures, notes)
    return edited_flat(path, read_picture(path, str(path)), puppet, origin.frame)


def _named(path: Path, pictures: Pictures, puppet: Puppet) -> dict[str, Picture]:
    """Give the pictures under the parts' own names; layers were renamed where a name is not usable."""
    taken: set[str] = set()
    known = {own_name(name, taken): name for name in puppet.names}
    for name in pictures:
        if name not in known:
            raise InputError(
                f"--texture {path}: layer {name!r} is no part of the puppet (parts: {', '.join(puppet.names)}); "
                "rename it or merge it into the part that it belongs to"
            )
    return {known[name]: picture for name, picture in pictures.items()}


def _folder(folder: Path, puppet: Puppet) -> dict[str, Picture]:
    """Read a puppet folder, or PNGs with the parts' names."""
    if (folder / PUPPET_FILE).is_file():
        cutout = read_cutout(folder)
        _require_size(folder, cutout.canvas, puppet.canvas)
        return _named(folder, {part.name: part.rgba for part in cutout.parts}, puppet)
    place = folder / "parts" if (folder / "parts").is_dir() else folder
    known = dict(zip(file_names(puppet.names), puppet.names, strict=True)) | {name: name for name in puppet.names}
    pictures = {}
    for file in sorted(place.glob("*.png")):
        if file.stem not in known:
            expected = ", ".join(f"{stem}.png" for stem in file_names(puppet.names))
            raise InputError(f"--texture {file}: no part has this name; expected {expected}")
        pictures[known[file.stem]] = _part_picture(file, puppet)
    if not pictures:
        raise InputError(f"--texture {folder}: expected PNGs named as the parts, as --template writes them; found none")
    return pictures


def _part_picture(file: Path, puppet: Puppet) -> Picture:
    with open_picture(file, str(file), ("PNG",)) as image:
        _require_size(file, image.size, puppet.canvas)
        if not image.has_transparency_data:
            raise InputError(f"--texture {file}: has no transparency; save the part as RGBA")
    return read_picture(file, str(file), ("PNG",))


def _require_size(path: Path, found: tuple[int, int], canvas: tuple[int, int]) -> None:
    if found != canvas:
        raise InputError(
            f"--texture {path}: is {found[0]} x {found[1]}, the puppet's canvas is {canvas[0]} x {canvas[1]}; "
            "save it on the whole canvas, unscaled"
        )


def _of_parts(path: Path, puppet: Puppet, origin: Origin, after: Pictures, notes: Sequence[str]) -> Edit:
    """Compare with what the pictures are a copy of: the texture itself, or the puppet folder that the run was given."""
    candidates: list[Pictures] = [canvas_pictures(puppet)]
    if origin.cutout is not None and origin.cutout.canvas == puppet.canvas:
        given = {part.name: part.rgba for part in origin.cutout.parts}
        candidates += [given] if set(after) <= set(given) else []
    before = min(candidates, key=lambda each: sum(int(differs(each[name], after[name]).sum()) for name in after))
    edit = edited(puppet, before, after)
    return Edit(edit.puppet, edit.parts, edit.erases, (*notes, *edit.notes))


def read_given(folder: Path | None) -> CutOut | None:
    """Read the puppet folder that a run was given; None where it is gone or cannot be read any more."""
    try:
        return read_cutout(folder) if folder is not None and folder.is_dir() else None
    except PuppetError:
        return None
