"""Reading files that strangers made: how large anything may be, refusals of one line for what is too large or broken.

Sizes are looked at before anything is unpacked: zip bombs, huge canvases, entity expansion, deep nesting, numbers that
are none, and paths that lead out of the folder end here.
"""

import io
import json
import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import UInt8
from PIL import Image, UnidentifiedImageError

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.folder import LARGEST_SIDE, MOST_PIXELS

MOST_TOTAL_PIXELS = 2**28
"""Parts times canvas pixels; each is held in memory at four bytes."""
MOST_PARTS = 500
"""More parts than any puppet has: the file holds something else."""
MOST_BYTES = 2**30
"""Largest file that is read."""
MOST_TEXT = 2**26
"""Largest JSON, YAML or XML text."""
MOST_DEPTH = 64
"""Deepest nesting of groups."""
MOST_POINTS = 20_000
"""Most points of one outline."""
FARTHEST = 1e6
"""Coordinates beyond this are no place on a picture."""

PICTURES = ("PNG", "JPEG", "WEBP", "BMP", "TIFF", "GIF")

Rgba = UInt8[np.ndarray, "_ _ 4"]


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a file that is at most so large."""
    if not path.is_file():
        raise PuppetError(f"{path}: expected a file, found {'a folder' if path.is_dir() else 'nothing'}")
    try:
        size = path.stat().st_size
        if size > most:
            raise PuppetError(f"{path}: {size / 2**20:.0f} MiB is too large; at most {most / 2**20:.0f} MiB")
        return path.read_bytes()
    except OSError as error:
        raise PuppetError(f"{path}: cannot be read: {error.strerror or error}") from None


def read_text(path: Path) -> str:
    """Read a UTF-8 text file of bounded size."""
    try:
        return read_bytes(path, MOST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise PuppetError(f"{path}: cannot be read as UTF-8 text: {error}") from None


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object; NaN, infinities and endless nesting are refused."""
    text = read_text(path)
    try:
        tree = json.loads(
            text, parse_constant=lambda word: refuse(f"{path}: {word} is no number; expected finite ones")
        )
    except json.JSONDecodeError as error:
        raise PuppetError(f"{path}: not valid JSON at line {error.lineno}, column {error.colno}: {error.msg}") from None
    except (RecursionError, ValueError) as error:
        raise PuppetError(f"{path}: not usable JSON: {error}") from None
    if not isinstance(tree, dict):
        raise PuppetError(f"{path}: expected a JSON object, found {type(tree).__name__}")
    return tree


def read_xml(data: bytes, where: str) -> Element:
    """Parse XML; entities that expand and references to other files are refused."""
    import xml.etree.ElementTree as ElementTree

    defused = needed("defusedxml.ElementTree", where)
    if len(data) > MOST_TEXT:
        raise PuppetError(f"{where}: {len(data) / 2**20:.0f} MiB of XML is too much; at most {MOST_TEXT / 2**20:.0f}")
    try:
        root: Element = defused.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # what defusedxml raises is a ValueError
        reason = " ".join(str(error).split())
        raise PuppetError(f"{where}: XML that cannot be used ({type(error).__name__}: {reason})") from None
    return root


def needed(module: str, where: str) -> Any:
    """Import a library of the extra ``import``, or say how to install it."""
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError:
        name = module.partition(".")[0]
        raise PuppetError(f"{where}: reading this needs {name}; python -m pip install 'wildpuppet[import]'") from None


def shown(value: object) -> str:
    """Write a value of a file into a message: short, and never the whole of a nested one (aliases unfold for ever)."""
    if isinstance(value, str):
        return repr(value[:60])
    return repr(value) if value is None or isinstance(value, bool | int | float) else f"a {type(value).__name__}"


def refuse(message: str) -> NoReturn:
    """Raise PuppetError where only an expression fits."""
    raise PuppetError(message)


def require_canvas(canvas: tuple[int, int], num_parts: int, where: str) -> None:
    """Refuse a canvas without area, one too big, or too many parts on it."""
    width, height = canvas
    if width < 1 or height < 1:
        raise PuppetError(f"{where}: the canvas is {width} x {height}; expected at least one pixel")
    if max(canvas) > LARGEST_SIDE or width * height > MOST_PIXELS:
        raise PuppetError(
            f"{where}: canvas {width} x {height} is too big; at most {LARGEST_SIDE} along a side and {MOST_PIXELS} "
            "pixels: scale the picture down"
        )
    if num_parts > MOST_PARTS:
        raise PuppetError(f"{where}: {num_parts} layers; at most {MOST_PARTS}: merge what moves together")
    if width * height * num_parts > MOST_TOTAL_PIXELS:
        raise PuppetError(
            f"{where}: {num_parts} layers of {width} x {height} are too much to hold; scale the picture down or merge "
            "what moves together"
        )


def number(value: object, where: str, *, farthest: float = FARTHEST) -> float:
    """Give a finite number of reasonable size; text that spells one counts (XML)."""
    try:
        found = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else math.nan
    except (ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found) or abs(found) > farthest:
        raise PuppetError(f"{where} is {shown(value)}; expected a number within {farthest:g}")
    return found


def listed(value: object) -> list[Any]:
    """Give a list as it is, and an empty one for whatever else stands in its place."""
    return value if isinstance(value, list) else []


def place(value: object, where: str) -> tuple[float, float]:
    """Give an [x, y] of two finite numbers."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise PuppetError(f"{where} is {shown(value)}; expected [x, y]")
    return number(value[0], where), number(value[1], where)


def inside(folder: Path, name: object, where: str) -> Path:
    """Find a file that another one names, relative to its folder and within it."""
    if not isinstance(name, str) or not name or "\0" in name:
        raise PuppetError(f"{where}: expected a file's name, found {shown(name)}")
    plain = name.replace("\\", "/")
    if len(name) > 1000 or any(len(piece.encode()) > 250 for piece in plain.split("/")):
        raise PuppetError(f"{where}: the file name {name[:40]!r}... is too long")
    path = folder / plain
    if re.match(r"[A-Za-z]:|/|[a-z]+://", plain) or not path.resolve().is_relative_to(folder.resolve()):
        raise PuppetError(f"{where}: {name[:80]!r} lies outside its folder; move it inside")
    return path


def read_picture(source: Path | bytes, where: str, formats: tuple[str, ...] = PICTURES) -> Rgba:
    """Decode a picture to RGBA, straight alpha; its size is looked at first. Opaque kinds get alpha 255."""
    with open_picture(source, where, formats) as image:
        return np.array(image.convert("RGBA"))


@contextmanager
def open_picture(source: Path | bytes, where: str, formats: tuple[str, ...] = PICTURES) -> Iterator[Image.Image]:
    """Open a picture whose canvas is not too big; what cannot be decoded inside is a PuppetError."""
    data = read_bytes(source) if isinstance(source, Path) else source
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # our own bound is lower
            with Image.open(io.BytesIO(data), formats=formats) as image:
                require_canvas(image.size, 1, where)
                yield image
    except UnidentifiedImageError:
        raise PuppetError(f"{where}: not a picture we read; expected {', '.join(formats)}") from None
    except Image.DecompressionBombError:
        raise PuppetError(f"{where}: the picture is too big; scale it down") from None
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise PuppetError(f"{where}: cannot be read: {error}") from None
