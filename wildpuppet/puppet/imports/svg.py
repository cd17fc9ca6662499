"""SVG drawn over a frame, as Inkscape, Illustrator, Figma or Affinity save it: one named shape or group per part.

Document order is back to front. A shape with a name of its own (``inkscape:label``, a title, an ``id`` that is not the
program's) is a part; shapes without one are pieces of the group around them. A shape named ``torso+head`` is a hinge at
its middle. The frame lies where the SVG's ``<image>`` lies, else it fills the ``viewBox``.
"""

import base64
import binascii
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.coverage import Rule
from wildpuppet.puppet.imports.labelme import hinge_names, oriented
from wildpuppet.puppet.imports.limits import (
    MOST_DEPTH,
    MOST_PARTS,
    MOST_TEXT,
    Rgba,
    inside,
    read_bytes,
    read_picture,
    read_xml,
)
from wildpuppet.puppet.imports.result import own_name
from wildpuppet.puppet.imports.svg_shapes import (
    SHAPES,
    Matrix,
    Shape,
    length,
    local,
    shape_of,
    style_of,
    transform_of,
)
from wildpuppet.puppet.outlines import Outline, Outlines
from wildpuppet.types import JointSpec

_INKSCAPE_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_GROUPS = ("g", "a", "switch")
_DRAWN = ("text", "use", "line", "image", "foreignObject", "svg")
_PROGRAMS_NAME = re.compile(
    r"(svg|path|rect|circle|ellipse|polygon|polyline|line|g|group|layer|shape|vector|image)[ _-]?\d*([_-]\d+)*", re.I
)
_RULES: dict[str, Rule] = {"evenodd": "evenodd", "nonzero": "nonzero"}
_FULL_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True, eq=False)
class _Found:
    """A shape with its name, if a person gave it one, and the nearest named group around it."""

    name: str
    group: str
    group_number: int
    shape: Shape


@dataclass(eq=False)
class Drawing:
    """What an SVG holds: shapes in document order, the picture under them, the rectangle that the frame fills."""

    frame_box: tuple[float, float, float, float]
    document_from_frame_box: Matrix
    stretch: bool
    href: str = ""
    found: list[_Found] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    num_groups: int = 0
    patterns: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class _Around:
    """What the groups around an element say."""

    matrix: Matrix
    rule: Rule = "nonzero"
    group: str = ""
    number: int = 0
    depth: int = 0
    only_image: bool = False


def read_drawing(path: Path) -> Drawing:
    """Read an SVG's shapes and where its frame lies; raises PuppetError where it cannot be used."""
    where = str(path)
    root = read_xml(read_bytes(path, MOST_TEXT), where)
    if local(root.tag) != "svg":
        raise PuppetError(f"{where}: expected an SVG, found <{local(root.tag)[:40]}>")
    drawing = Drawing(_view_box(root, where), np.eye(3), False)
    drawing.patterns = frozenset(each.get("id", "") for each in root.iter() if local(each.tag) == "pattern")
    for element, around in _elements(root, _Around(np.eye(3)), drawing, where):
        _take(element, around, drawing, where)
    if len(drawing.found) > MOST_PARTS:
        raise PuppetError(f"{where}: {len(drawing.found)} shapes; at most {MOST_PARTS}")
    return drawing


def linked_frame(drawing: Drawing, path: Path) -> Rgba | None:
    """Decode the picture that the SVG embeds or that lies in its folder, None where it has none."""
    if not drawing.href:
        return None
    where = f"{path}: <image>"
    embedded = re.match(r"data:image/[\w.+-]+;base64,", drawing.href)
    if embedded:
        try:
            return read_picture(base64.b64decode("".join(drawing.href[embedded.end() :].split())), where)
        except binascii.Error as error:
            raise PuppetError(f"{where}: not base64: {error}") from None
    return read_picture(inside(path.parent, unquote(drawing.href), where), where)


def outlines_of(drawing: Drawing, frame_size: tuple[int, int], path: Path) -> Outlines:
    """Carry the shapes to frame pixels and sort them into parts and hinges."""
    frame_from_document = _frame_from_document(drawing, frame_size, str(path))
    single = len({_key(found, index) for index, found in enumerate(drawing.found)}) == 1
    parts: dict[object, list[_Found]] = {}
    hinges: list[tuple[tuple[str, str], tuple[float, float]]] = []
    for index, found in enumerate(drawing.found):
        rings = tuple(ring @ frame_from_document[:2, :2].T + frame_from_document[:2, 2] for ring in found.shape.rings)
        moved = replace(found, shape=Shape(rings, found.shape.rule))
        names = hinge_names(found.name)
        if names is None:
            parts.setdefault(index if single else _key(found, index), []).append(moved)
        else:
            points = np.concatenate(rings)
            x, y = (points.min(axis=0) + points.max(axis=0)) / 2.0
            hinges.append((names, (float(x), float(y))))
    taken: set[str] = set()
    outlines = tuple(_outline(pieces, taken) for pieces in parts.values())
    return Outlines(outlines, tuple(JointSpec(names, at) for names, at in hinges))


def _key(found: _Found, index: int) -> object:
    """Tell pieces of one part: shapes without a name share the named group around them."""
    return found.group_number if not found.name and found.group_number else ("shape", index)


def _outline(pieces: list[_Found], taken: set[str]) -> Outline:
    name = own_name(pieces[0].name or pieces[0].group or "part", taken)
    shapes = [piece.shape for piece in pieces]
    if len(shapes) == 1:
        return Outline(name, shapes[0].rings[0], shapes[0].rings[1:], shapes[0].rule)
    rings = [ring for shape in shapes for ring in _additive(shape)]
    return Outline(name, rings[0], tuple(rings[1:]), "nonzero")


def _additive(shape: Shape) -> list[Float[np.ndarray, "_ 2"]]:
    """Turn a shape's rings so that shapes add up under the nonzero rule: areas one way round, holes the other."""
    if shape.rule == "nonzero":
        largest = max(shape.rings, key=lambda ring: float(np.prod(np.ptp(ring, axis=0))))
        keep = oriented(largest) is largest
        return [ring if keep else ring[::-1] for ring in shape.rings]
    rings = [oriented(ring) for ring in shape.rings]
    depths = [sum(_holds(other, ring[0]) for other in rings if other is not ring) for ring in rings]
    return [ring[::-1] if depth % 2 else ring for ring, depth in zip(rings, depths, strict=True)]


def _holds(ring: Float[np.ndarray, "N 2"], point: Float[np.ndarray, "2"]) -> bool:
    (x0, y0), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
    crossed = (y0 <= point[1]) != (y1 <= point[1])
    x = x0[crossed] + (point[1] - y0[crossed]) * (x1 - x0)[crossed] / (y1 - y0)[crossed]
    return bool((x > point[0]).sum() % 2)


def _elements(group: Element, around: _Around, drawing: Drawing, where: str) -> Iterator[tuple[Element, _Around]]:
    """Walk what is drawn, in document order."""
    if around.depth > MOST_DEPTH:
        raise PuppetError(f"{where}: groups are nested more than {MOST_DEPTH} deep; ungroup some")
    for element in group:
        tag = local(element.tag)
        if tag not in (*_GROUPS, *SHAPES, *_DRAWN):
            continue
        name = _name(element)
        label = name or element.get("id") or tag
        is_hidden = style_of(element, "display") == "none" or style_of(element, "visibility") == "hidden"
        if is_hidden and not any(local(inner.tag) == "image" for inner in element.iter()):
            drawing.notes.append(f"{label[:80]!r} is hidden and left out")
            continue
        matrix = transform_of(element, around.matrix, f"{where}: {label[:80]!r}")
        # A frame that is hidden while one draws still says where the frame lies.
        here = replace(
            around,
            only_image=around.only_image or is_hidden,
            matrix=matrix,
            rule=_RULES.get(style_of(element, "fill-rule") or "", around.rule),
        )
        if tag in _GROUPS:
            if name:
                drawing.num_groups += 1
                here = replace(here, group=name, number=drawing.num_groups)
            yield from _elements(element, replace(here, depth=around.depth + 1), drawing, where)
        else:
            yield element, here


def _take(element: Element, around: _Around, drawing: Drawing, where: str) -> None:
    tag, name = local(element.tag), _name(element)
    label = f"{where}: {(name or element.get('id') or tag)[:80]!r}"
    if tag == "image":
        _take_image(element, around.matrix, drawing, label)
    elif around.only_image:
        drawing.notes.append(f"{(name or element.get('id') or tag)[:80]!r} is hidden and left out")
    elif _pattern_filled(element, drawing):
        drawing.notes.append(f"{(name or element.get('id') or tag)[:80]!r} shows a picture and is left out")
    elif tag in _DRAWN:
        drawing.notes.append(f"a <{tag}> is left out; outlines are paths and shapes")
    else:
        shape = shape_of(element, around.matrix, around.rule, label)
        if shape is None:
            drawing.notes.append(f"{name or element.get('id') or tag!r} has no area and is left out")
        else:
            drawing.found.append(_Found(name, around.group, around.number, shape))


def _pattern_filled(element: Element, drawing: Drawing) -> bool:
    """Say whether a shape is filled with a pattern: so Figma writes a picture."""
    fill = re.match(r"url\(['\"]?#([^)'\"]+)", style_of(element, "fill") or "")
    return fill is not None and fill[1] in drawing.patterns


def _take_image(element: Element, matrix: Matrix, drawing: Drawing, where: str) -> None:
    """Take the first picture for the frame."""
    if drawing.href:
        drawing.notes.append("a second <image> is left out; the first is taken for the frame")
        return
    drawing.href = next((href for name in _HREFS if (href := element.get(name))), "")
    x, y, width, height = (length(element.get(name), f"{where} {name}") for name in ("x", "y", "width", "height"))
    if width <= 0 or height <= 0:
        raise PuppetError(f"{where}: the picture under the outlines has no width and height")
    drawing.frame_box = (x, y, width, height)
    drawing.document_from_frame_box = matrix
    fitting = (element.get("preserveAspectRatio") or "xMidYMid").split()
    if "slice" in fitting or fitting[0] not in ("xMidYMid", "none"):
        raise PuppetError(f"{where}: preserveAspectRatio {' '.join(fitting)[:40]!r}; expected xMidYMid meet or none")
    drawing.stretch = fitting[0] == "none"


def _frame_from_document(drawing: Drawing, frame_size: tuple[int, int], where: str) -> Matrix:
    """Find the map from the document's coordinates to frame pixels."""
    x, y, width, height = drawing.frame_box
    scales = np.array([width / frame_size[0], height / frame_size[1]])
    if not drawing.href and abs(scales[0] / scales[1] - 1.0) > 0.01:
        raise PuppetError(
            f"{where}: the drawing is {width:g} x {height:g}, the frame {frame_size[0]} x {frame_size[1]}: not of "
            "one shape; keep the frame's <image> in the SVG, so that it says where the frame lies"
        )
    if drawing.href and not drawing.stretch:
        scales[:] = scales.min()
    rest = np.array([width, height]) - scales * frame_size
    box_from_frame = np.array([[scales[0], 0.0, x + rest[0] / 2], [0.0, scales[1], y + rest[1] / 2], [0.0, 0.0, 1.0]])
    document_from_frame = drawing.document_from_frame_box @ box_from_frame
    if abs(np.linalg.det(document_from_frame)) < 1e-12:
        raise PuppetError(f"{where}: the picture under the outlines has no area")
    return np.linalg.inv(document_from_frame)


def _view_box(root: Element, where: str) -> tuple[float, float, float, float]:
    """Give the rectangle of user units that the drawing shows."""
    numbers = [float(text) for text in re.findall(_FULL_NUMBER, root.get("viewBox") or "")]
    if len(numbers) == 4 and numbers[2] > 0 and numbers[3] > 0 and max(map(abs, numbers)) < 1e6:
        return numbers[0], numbers[1], numbers[2], numbers[3]
    width, height = (length(root.get(name), f"{where}: {name}") for name in ("width", "height"))
    return 0.0, 0.0, max(width, 1.0), max(height, 1.0)


def _name(element: Element) -> str:
    """Give the name that a person gave an element; empty where there is none."""
    title = next((child.text for child in element if local(child.tag) == "title" and child.text), None)
    given = (element.get(_INKSCAPE_LABEL) or title or element.get("id") or "").strip()
    # Illustrator writes what an id cannot hold as _x002B_.
    given = re.sub(r"_x([0-9A-Fa-f]{4})_", lambda code: chr(int(code[1], 16)), given)
    return "" if _PROGRAMS_NAME.fullmatch(given) else given
