"""A cut-out puppet as a folder that a person can open and edit: ``puppet.json`` and one RGBA picture per part.

    {"schema": "wildpuppet.puppet/1", "canvas": [W, H], "reference": 0 or null,
     "parts":  [{"name": "torso", "image": "parts/torso.png"}, ...],
     "joints": [{"parts": ["torso", "head"], "at": [x, y]}, ...]}

Parts are listed back to front; each picture covers the whole canvas, with straight alpha. ``at`` is in canvas pixels
and may be left out. Fields that we do not know are passed over with a logged warning.
"""

import json
import logging
import math
import re
import shutil
import uuid
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from jaxtyping import UInt8
from msgspec import Meta
from PIL import Image

from wildpuppet.errors import PuppetError
from wildpuppet.types import CutOut, JointSpec, Part

SCHEMA = "wildpuppet.puppet/1"
LARGEST_SIDE = 16384
"""Canvas sides beyond this are taken for a mistake."""
MOST_PIXELS = 2**26
"""Canvas area limit: every part is held in memory at four bytes per pixel."""

_logger = logging.getLogger(__name__)

Name = Annotated[str, Meta(min_length=1, max_length=100)]
Side = Annotated[int, Meta(ge=1, le=LARGEST_SIDE)]


class _PartEntry(msgspec.Struct):
    name: Name
    image: Annotated[str, Meta(min_length=1)]


class _JointEntry(msgspec.Struct, omit_defaults=True):
    parts: tuple[str, str]
    at: tuple[float, float] | None = None


class _PuppetFile(msgspec.Struct):
    schema: str
    canvas: tuple[Side, Side]
    parts: Annotated[list[_PartEntry], Meta(min_length=1)]
    reference: int | None = None
    joints: list[_JointEntry] = []


def read_cutout(folder: Path) -> CutOut:
    """Read a puppet folder.

    Raises:
        PuppetError: the folder, its puppet.json or a picture is missing or not as the format asks; one line that
            names the file and what to do.
    """
    entry = _read_puppet_file(folder)
    _require_consistent(folder, entry)
    parts = tuple(Part(part.name, _read_picture(folder, part, entry.canvas)) for part in entry.parts)
    joints = tuple(JointSpec(joint.parts, joint.at) for joint in entry.joints)
    return CutOut(entry.canvas, parts, joints, entry.reference)


def write_cutout(cutout: CutOut, folder: Path, *, overwrite: bool = False) -> None:
    """Write a puppet folder; it appears whole or not at all.

    With ``overwrite`` the files of an existing folder are replaced one by one, ``puppet.json`` last, and what else
    lies in the folder stays.

    Raises:
        PuppetError: the folder exists and ``overwrite`` is off, or it cannot be written.
    """
    if folder.exists() and not overwrite:
        raise PuppetError(f"puppet {folder}: already exists; choose another folder or ask for it to be overwritten")
    try:
        beside = folder.parent / f".{folder.name}.{uuid.uuid4().hex}"
        beside.mkdir(parents=True)
        try:
            _write_files(cutout, beside)
            _publish(beside, folder)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except OSError as error:
        raise PuppetError(f"puppet {folder}: cannot be written: {error.strerror or error}") from None


def _read_puppet_file(folder: Path) -> _PuppetFile:
    path = folder / "puppet.json"
    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing"
        raise PuppetError(f"puppet {folder}: expected a folder with puppet.json and parts/, found {found} there")
    if not path.is_file():
        raise PuppetError(f"puppet {folder}: no puppet.json in it; is this a puppet folder?")
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise PuppetError(f"{path}: not valid JSON at line {error.lineno}, column {error.colno}: {error.msg}") from None
    except (UnicodeDecodeError, OSError, RecursionError) as error:
        raise PuppetError(f"{path}: cannot be read as UTF-8 text: {error}") from None
    _require_schema(path, tree)
    _require_finite(path, tree, "")
    try:
        entry = msgspec.convert(tree, _PuppetFile)
    except msgspec.ValidationError as error:
        raise PuppetError(f"{path}: {error}") from None
    unknown = sorted(set(tree) - set(_PuppetFile.__struct_fields__))
    if unknown:
        _logger.warning("%s: passed over the unknown field(s) %s", path, ", ".join(unknown))
    return entry


def _require_schema(path: Path, tree: object) -> None:
    if not isinstance(tree, dict):
        raise PuppetError(f"{path}: expected an object with schema, canvas, parts and joints, found another JSON value")
    schema = tree.get("schema")
    if schema == SCHEMA:
        return
    newer = re.fullmatch(r"wildpuppet\.puppet/(\d+)", schema) if isinstance(schema, str) else None
    if newer and int(newer[1]) > int(SCHEMA.rsplit("/", 1)[1]):
        raise PuppetError(f"{path}: written by a newer wildpuppet (schema {schema}, we read {SCHEMA}); please upgrade")
    raise PuppetError(f'{path}: expected "schema": "{SCHEMA}", found {json.dumps(schema)}')


def _require_finite(path: Path, value: object, where: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise PuppetError(f"{path}: {where.lstrip('.')} is {value}; expected a finite number")
    if isinstance(value, dict):
        for key, child in value.items():
            _require_finite(path, child, f"{where}.{key}")
    elif isinstance(value, list):
        for index, child in enumerate(value):
            _require_finite(path, child, f"{where}[{index}]")


def _require_consistent(folder: Path, entry: _PuppetFile) -> None:
    width, height = entry.canvas
    if width * height > MOST_PIXELS:
        raise PuppetError(f"puppet {folder}: canvas {width} x {height} is too big; at most {MOST_PIXELS} pixels")
    names = [part.name for part in entry.parts]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise PuppetError(f"puppet {folder}: two parts are named {twice[0]!r}; each part needs a name of its own")
    for index, joint in enumerate(entry.joints):
        unknown = [name for name in joint.parts if name not in names]
        if unknown:
            raise PuppetError(f"puppet {folder}: joint {index} names the unknown part {unknown[0]!r}; parts: {names}")
        if joint.parts[0] == joint.parts[1]:
            raise PuppetError(f"puppet {folder}: joint {index} ties {joint.parts[0]!r} to itself; name two parts")


def _read_picture(folder: Path, part: _PartEntry, canvas: tuple[int, int]) -> UInt8[np.ndarray, "H W 4"]:
    path = folder / part.image
    where = f"puppet {folder}: part {part.name!r}: image {part.image}"
    if "\0" in part.image or not path.resolve().is_relative_to(folder.resolve()):
        raise PuppetError(f"{where} lies outside the puppet's folder; move it inside")
    if not path.is_file():
        raise PuppetError(f"{where} is missing")
    try:
        with Image.open(path) as image:
            if image.size != canvas:
                found, expected = "{} x {}".format(*image.size), "{} x {}".format(*canvas)
                raise PuppetError(f"{where} is {found}, the canvas is {expected}; every part covers the whole canvas")
            if image.mode != "RGBA":
                raise PuppetError(f"{where} has mode {image.mode}{_missing_alpha(image.mode)}; expected 8-bit RGBA")
            rgba = np.asarray(image, dtype=np.uint8)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PuppetError(f"{where} cannot be read: {error}") from None
    if not rgba[..., 3].any():
        raise PuppetError(f"{where} is fully transparent; draw the part or remove it from puppet.json")
    return rgba


def _missing_alpha(mode: str) -> str:
    return " without alpha (transparency)" if mode in ("RGB", "L", "1", "I", "F", "P", "CMYK", "YCbCr") else ""


def _write_files(cutout: CutOut, folder: Path) -> None:
    (folder / "parts").mkdir(parents=True)
    parts: list[dict[str, str]] = []
    taken: set[str] = set()
    for part in cutout.parts:
        image = f"parts/{_file_name(part.name, taken)}.png"
        Image.fromarray(np.ascontiguousarray(part.rgba)).save(folder / image)
        parts.append({"name": part.name, "image": image})
    tree: dict[str, Any] = {"schema": SCHEMA, "canvas": list(cutout.canvas), "reference": cutout.reference}
    tree["parts"] = parts
    tree["joints"] = [_joint_entry(joint) for joint in cutout.joints]
    text = json.dumps(tree, indent=1, ensure_ascii=False)
    (folder / "puppet.json").write_text(text + "\n", encoding="utf-8")


def _joint_entry(joint: JointSpec) -> dict[str, Any]:
    at = {} if joint.at is None else {"at": [float(joint.at[0]), float(joint.at[1])]}
    return {"parts": list(joint.parts), **at}


def _file_name(name: str, taken: set[str]) -> str:
    """Make a name that every file system takes, unlike the ones taken (also where case does not count)."""
    plain = re.sub(r"[^\w.-]+", "_", name).strip("._") or "part"
    choice, number = plain, 2
    while choice.lower() in taken:
        choice, number = f"{plain}_{number}", number + 1
    taken.add(choice.lower())
    return choice


def _publish(beside: Path, folder: Path) -> None:
    if not folder.exists():
        beside.rename(folder)
        return
    (folder / "parts").mkdir(exist_ok=True)
    for image in sorted((beside / "parts").iterdir()):
        image.replace(folder / "parts" / image.name)
    (beside / "puppet.json").replace(folder / "puppet.json")
