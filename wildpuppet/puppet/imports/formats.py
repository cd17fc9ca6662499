"""The formats that puppets are imported from, in one table, and which of them a file is."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports import animated_drawings, dragonbones, from_frame, ora, png_folder, psd
from wildpuppet.puppet.imports.limits import MOST_TEXT, read_bytes
from wildpuppet.puppet.imports.result import Imported

Name = Literal["psd", "ora", "png", "svg", "labelme", "coco", "animated-drawings", "dragonbones"]


@dataclass(frozen=True)
class Format:
    """One format: what it is, who writes it, what it takes over exactly, and how it is read."""

    what: str
    written_by: str
    keeps: str
    library: str
    read: Callable[[Path], Imported] | None = None
    over_frame: from_frame.Reader | None = None


FORMATS: dict[Name, Format] = {
    "psd": Format(
        "layered PSD, PSB", "Photoshop, Clip Studio, Krita, GIMP, See-through",
        "pixels, order, names, offsets, masks; blend modes and effects approximate", "psd-tools", read=psd.read_psd,
    ),
    "ora": Format(
        "OpenRaster", "Krita, MyPaint, GIMP, Pinta, Drawpile",
        "pixels, order, names, offsets; blend modes approximate", "defusedxml", read=ora.read_ora,
    ),
    "png": Format(
        "folder of RGBA pictures of one size", "any drawing program",
        "pixels, order by file name", "", read=png_folder.read_png_folder,
    ),
    "svg": Format(
        "outlines over a frame", "Inkscape, Illustrator, Figma, Affinity",
        "outlines, order, names, hinges named a+b", "svgpathtools", over_frame=from_frame.read_svg,
    ),
    "labelme": Format(
        "LabelMe JSON over a frame", "LabelMe, CVAT, X-AnyLabeling, Roboflow",
        "outlines, order, names, hinges named a+b", "", over_frame=from_frame.read_labelme,
    ),
    "coco": Format(
        "COCO annotations over a frame", "CVAT, Label Studio, Roboflow",
        "outlines and masks, order, names", "", over_frame=from_frame.read_coco,
    ),
    "animated-drawings": Format(
        "character folder", "AnimatedDrawings",
        "pixels, joints; cut into parts along the skeleton", "pyyaml", read=animated_drawings.read_animated_drawings,
    ),
    "dragonbones": Format(
        "rig, setup pose", "DragonBones, LoongBones, COA Tools",
        "order, names, bones as hinges; pictures resampled where turned", "", read=dragonbones.read_dragonbones,
    ),
}  # fmt: skip


HEADINGS = ("--from", "what", "written by", "taken over", "extra")


def rows() -> list[tuple[str, ...]]:
    """List the table's lines."""
    return [
        (name, each.what, each.written_by, each.keeps, "import" if each.library else "")
        for name, each in FORMATS.items()
    ]


def recognised(path: Path) -> Name:
    """Tell a file's or folder's format by what is in it, whatever its name.

    Raises:
        PuppetError: nothing there, or nothing that we know; says what to do where a program's own format is known.
    """
    if path.is_dir():
        return _recognised_folder(path)
    if not path.is_file():
        raise PuppetError(f"{path}: expected a file or a folder, found nothing there")
    head = _head(path)
    if head.startswith(psd.SIGNATURE):
        return "psd"
    if head.startswith(b"PK\x03\x04"):
        if ora.MIMETYPE in head[:200]:
            return "ora"
        what = "Krita's own format: save it as PSD or ORA" if b"application/x-kr" in head[:200] else "an archive"
        raise PuppetError(f"{path}: {what}; unpack it first" if what == "an archive" else f"{path}: {what}")
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text.startswith(b"{"):
        return _recognised_json(path)
    if text.startswith(b"<") and b"<svg" in read_bytes(path, MOST_TEXT):
        return "svg"
    raise PuppetError(f"{path}: not a format we read; expected one of {', '.join(FORMATS)}{_advice(path, head)}")


def read_puppet(
    path: Path, name: Name | None = None, frame: Path | None = None, *, merge_groups: bool = False
) -> Imported:
    """Read a puppet from another tool's file.

    ``name`` forces the format. ``frame`` is the picture that outlines were drawn on, where the file does not hold or
    name it. ``merge_groups`` paints the layers of a group into one part (PSD, ORA).

    Raises:
        PuppetError: what is wrong, in one line.
    """
    name = name or recognised(path)
    chosen = FORMATS[name]
    if chosen.over_frame is not None:
        return chosen.over_frame(path, frame)
    if frame is not None:
        raise PuppetError(f"{path}: a {name} holds its own pictures; leave --frame out")
    if name == "psd":
        return psd.read_psd(path, merge_groups=merge_groups)
    if name == "ora":
        return ora.read_ora(path, merge_groups=merge_groups)
    assert chosen.read is not None
    return chosen.read(path)


def _recognised_folder(path: Path) -> Name:
    if (path / "puppet.json").exists():
        raise PuppetError(f"{path}: is a puppet folder already; use it with --puppet as it is")
    if (path / animated_drawings.CONFIG).exists():
        return "animated-drawings"
    if dragonbones.skeleton_in(path):
        return "dragonbones"
    if png_folder.is_png_folder(path):
        return "png"
    raise PuppetError(
        f"{path}: a folder without what we know; expected RGBA PNGs, {animated_drawings.CONFIG} or NAME_ske.json in it"
    )


def _recognised_json(path: Path) -> Name:
    try:
        tree = json.loads(read_bytes(path, MOST_TEXT))
    except (ValueError, RecursionError) as error:
        raise PuppetError(f"{path}: not usable JSON: {' '.join(str(error).split())[:160]}") from None
    keys = {"shapes": "labelme", "annotations": "coco", "armature": "dragonbones"}
    for key, name in keys.items():
        if isinstance(tree, dict) and key in tree:
            return name  # type: ignore[return-value]
    if isinstance(tree, dict) and "skeleton" in tree and "bones" in tree:
        raise PuppetError(f"{path}: a Spine skeleton; export its pictures as a PSD or as PNGs and import those")
    raise PuppetError(f"{path}: JSON of no kind we know; expected LabelMe, COCO or a DragonBones skeleton")


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(4096)
    except OSError as error:
        raise PuppetError(f"{path}: cannot be read: {error.strerror or error}") from None


def _advice(path: Path, head: bytes) -> str:
    if head.startswith((b"\x89PNG", b"\xff\xd8", b"GIF8", b"RIFF")):
        return "; one flat picture has no parts: outline them (wildpuppet puppet from-outlines)"
    known = {".xcf": "save it as PSD or ORA", ".clip": "export it as PSD", ".aseprite": "export PNGs"}
    word = known.get(path.suffix.lower())
    return f"; {word}" if word else ""
