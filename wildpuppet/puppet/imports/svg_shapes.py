"""SVG's shapes as rings of points: paths and basic shapes through all transforms around them.

svgpathtools (MIT) reads path data, arcs and transforms; the tree is walked here, after defusedxml has read it.
"""

import math
import re
import warnings
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.coverage import Rule
from wildpuppet.puppet.imports.limits import FARTHEST, MOST_POINTS, needed, number

SHAPES = ("path", "rect", "circle", "ellipse", "polygon", "polyline")
FLATNESS = 0.02
"""How far a chord may stray from its curve, as a share of the picture's thousandth part (about a pixel)."""
MOST_PATH = 2**20
"""Longest path data, characters."""

_LENGTH = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([a-z%]*)\s*$")
_PIXELS = {"": 1.0, "px": 1.0, "pt": 4 / 3, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}

Matrix = Float[np.ndarray, "3 3"]


@dataclass(frozen=True, eq=False)
class Shape:
    """One drawn shape: its rings in the document's coordinates and the rule that says what is inside."""

    rings: tuple[Float[np.ndarray, "_ 2"], ...]
    rule: Rule


def local(tag: object) -> str:
    """Give an element's name without its namespace; comments have none."""
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""


def style_of(element: Element, name: str) -> str | None:
    """Find a presentation property, in ``style`` or as an attribute."""
    for declaration in (element.get("style") or "").split(";"):
        key, _, value = declaration.partition(":")
        if key.strip() == name:
            return value.strip()
    return element.get(name)


def length(text: str | None, where: str, default: float = 0.0) -> float:
    """Read a length in user units; absolute CSS units are converted."""
    if text is None:
        return default
    parts = _LENGTH.match(text)
    if parts is None or parts[2] not in _PIXELS:
        raise PuppetError(f"{where} is {text[:40]!r}; expected a length in user units, px, mm, cm, in or pt")
    return number(parts[1], where) * _PIXELS[parts[2]]


def transform_of(element: Element, around: Matrix, where: str) -> Matrix:
    """Multiply an element's own transform to the one around it (document from element)."""
    text = element.get("transform")
    if not text:
        return around
    try:
        own = needed("svgpathtools.parser", where).parse_transform(text[:10_000], strict=True)
    except (ValueError, IndexError, TypeError) as error:
        raise PuppetError(f"{where}: transform that cannot be read: {' '.join(str(error).split())}") from None
    matrix: Matrix = around @ np.asarray(own, np.float64)
    if not (np.abs(matrix) <= FARTHEST).all():
        raise PuppetError(f"{where}: its transforms are no usable numbers")
    return matrix


def shape_of(element: Element, document_from_element: Matrix, rule: Rule, where: str) -> Shape | None:
    """Flatten a shape to rings in the document's coordinates; None where it has no area at all."""
    data = _path_data(element, where)
    if len(data) > MOST_PATH:
        raise PuppetError(f"{where}: path data of {len(data)} characters; at most {MOST_PATH}")
    library = needed("svgpathtools", where)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # arcs of no radius are lines, as SVG asks
            path = library.parse_path(data)
            pieces = [_flattened(piece, document_from_element) for piece in path.continuous_subpaths()] if path else []
    except (ValueError, IndexError, TypeError, ArithmeticError, AssertionError) as error:
        raise PuppetError(f"{where}: path that cannot be read: {' '.join(str(error).split())[:120]}") from None
    rings = [piece for piece in pieces if len(piece) >= 3]
    if any(len(ring) > MOST_POINTS or not (np.abs(ring) <= FARTHEST).all() for ring in rings):
        raise PuppetError(f"{where}: its points are too many or no usable numbers")
    return Shape(tuple(rings), rule) if rings else None


def _path_data(element: Element, where: str) -> str:
    """Write any basic shape as path data."""
    tag = local(element.tag)
    if tag == "path":
        return element.get("d") or ""
    if tag in ("polygon", "polyline"):
        points = re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", element.get("points") or "")
        return f"M {' '.join(points[: len(points) // 2 * 2])} Z" if len(points) >= 6 else ""
    if tag == "rect":
        x, y, width, height = (length(element.get(name), f"{where} {name}") for name in ("x", "y", "width", "height"))
        if width <= 0 or height <= 0:
            return ""
        return _rounded(x, y, width, height, *_corner_radii(element, width, height, where))
    middle = [length(element.get(name), f"{where} {name}") for name in ("cx", "cy")]
    names = ("r", "r") if tag == "circle" else ("rx", "ry")
    rx, ry = (length(element.get(name), f"{where} {name}") for name in names)
    if rx <= 0 or ry <= 0:
        return ""
    x, y = middle
    return f"M {x - rx} {y} A {rx} {ry} 0 0 1 {x + rx} {y} A {rx} {ry} 0 0 1 {x - rx} {y} Z"


def _corner_radii(element: Element, width: float, height: float, where: str) -> tuple[float, float]:
    given = [element.get("rx"), element.get("ry")]
    rx, ry = (length(text, f"{where} {name}") if text else None for name, text in zip(("rx", "ry"), given, strict=True))
    rx = (ry if rx is None else rx) or 0.0
    ry = (rx if ry is None else ry) or 0.0
    return min(max(rx, 0.0), width / 2), min(max(ry, 0.0), height / 2)


def _rounded(x: float, y: float, width: float, height: float, rx: float, ry: float) -> str:
    if rx <= 0 or ry <= 0:
        return f"M {x} {y} H {x + width} V {y + height} H {x} Z"
    return (
        f"M {x + rx} {y} H {x + width - rx} A {rx} {ry} 0 0 1 {x + width} {y + ry} V {y + height - ry} "
        f"A {rx} {ry} 0 0 1 {x + width - rx} {y + height} H {x + rx} A {rx} {ry} 0 0 1 {x} {y + height - ry} "
        f"V {y + ry} A {rx} {ry} 0 0 1 {x + rx} {y} Z"
    )


def _flattened(path: Any, matrix: Matrix) -> Float[np.ndarray, "N 2"]:
    """Sample the segments of one subpath finely enough, and carry the points to the document."""
    scale = max(float(np.linalg.norm(matrix[:2, :2], 2)), 1e-12)
    points: list[complex] = []
    for segment in path:
        count = _count(segment, scale)
        points += [segment.start] if count == 1 else [segment.point(index / count) for index in range(count)]
        if len(points) > MOST_POINTS:
            break
    points.append(path[-1].end)
    if len(points) > 1 and points[0] == points[-1]:
        points.pop()
    flat = np.array([(point.real, point.imag, 1.0) for point in points])
    places: Float[np.ndarray, "N 2"] = (flat @ matrix.T)[:, :2]
    return places


def _count(segment: Any, scale: float) -> int:
    """Choose the number of chords: a chord over a parameter step h strays at most h^2 / 8 times the acceleration."""
    kind = type(segment).__name__
    if kind == "Line":
        return 1
    if kind == "Arc":
        turn = math.radians(abs(segment.delta))
        acceleration = max(abs(segment.radius.real), abs(segment.radius.imag)) * turn**2
    else:
        points = segment.bpoints()
        bends = [abs(a - 2 * b + c) for a, b, c in zip(points, points[1:], points[2:], strict=False)]
        acceleration = (len(points) - 1) * (len(points) - 2) * max(bends)
    wanted = math.sqrt(acceleration * scale / (8.0 * FLATNESS))
    return min(max(math.ceil(wanted), 2), 2000)
