"""LabelMe's JSON, which CVAT, X-AnyLabeling and Roboflow write too: one shape per part over one frame.

The order of the shapes is back to front. Polygons, rectangles and circles are parts (shapes with the same label and
``group_id`` are pieces of one part); a point labelled ``torso+head`` is a hinge.
"""

import base64
import binascii
import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import FARTHEST, MOST_PARTS, MOST_POINTS, Rgba, read_json, read_picture
from wildpuppet.puppet.outlines import Outline, Outlines
from wildpuppet.types import JointSpec

_CIRCLE_POINTS = 90


def read_outlines(path: Path | str) -> Outlines:
    """Read the parts and hinges of a LabelMe file.

    ``imageWidth`` and ``imageHeight`` give the canvas. Two fields of ours at the top level, which LabelMe keeps:
    ``reference``, the frame's number, and ``halo`` (see Outlines). Raises PuppetError with the shape's number where a
    shape cannot be used.
    """
    path = Path(path)
    return outlines_of(read_json(path), path)


def outlines_of(tree: dict[str, Any], path: Path) -> Outlines:
    """Take the outlines from a LabelMe file's content."""
    shapes = tree.get("shapes")
    if not isinstance(shapes, list):
        raise PuppetError(f"{path}: expected LabelMe JSON with a list 'shapes', found {type(shapes).__name__}")
    if len(shapes) > MOST_PARTS:
        raise PuppetError(f"{path}: {len(shapes)} shapes; at most {MOST_PARTS}")
    parts: dict[object, Outline] = {}
    joints = []
    for number, shape in enumerate(shapes):
        where = f"{path}: shape {number}"
        label, kind, points = _read_shape(shape, where)
        if kind == "point":
            joints.append(_joint(label, points, where))
            continue
        ring = _ring(label, kind, points, where)
        key = number if shape.get("group_id") is None else (label, str(shape["group_id"]))
        known = parts.get(key)
        parts[key] = Outline(label, ring) if known is None else joined(known, ring)
    width, height = _read_count(tree, "imageWidth", path), _read_count(tree, "imageHeight", path)
    canvas = None if width is None or height is None else (width, height)
    reference, halo = _read_count(tree, "reference", path), _read_count(tree, "halo", path)
    return Outlines(
        tuple(parts.values()), tuple(joints), canvas, reference, Outlines.halo if halo is None else min(halo, 100)
    )


def embedded_frame(tree: dict[str, Any], path: Path) -> Rgba | None:
    """Decode the frame that LabelMe keeps inside the file (``imageData``), if it does."""
    data = tree.get("imageData")
    if not isinstance(data, str) or not data:
        return None
    try:
        return read_picture(base64.b64decode(data, validate=True), f"{path}: imageData")
    except binascii.Error as error:
        raise PuppetError(f"{path}: imageData is not base64: {error}") from None


def joined(outline: Outline, ring: Float[np.ndarray, "N 2"]) -> Outline:
    """Add a further piece to a part; pieces that overlap are one area."""
    first = oriented(outline.points)
    return Outline(outline.name, first, (*outline.further, oriented(ring)), "nonzero")


def oriented(ring: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
    """Turn a ring so that it runs clockwise on the screen: with the nonzero rule such rings add up."""
    x, y = ring.T
    return ring if float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) >= 0.0 else ring[::-1]


def _read_count(tree: dict[str, Any], name: str, path: Path) -> int | None:
    count = tree.get(name)
    if count is None:
        return None
    if not isinstance(count, int) or isinstance(count, bool) or count < 0:
        raise PuppetError(f"{path}: {name} is {count!r}; expected a whole number, 0 or more")
    return count


def _read_shape(shape: object, where: str) -> tuple[str, str, Float[np.ndarray, "N 2"]]:
    if not isinstance(shape, dict) or not isinstance(shape.get("label"), str) or not shape["label"]:
        raise PuppetError(f"{where} has no label; give every polygon the part's name")
    kind = shape.get("shape_type") or "polygon"
    return shape["label"], str(kind), read_points(shape.get("points"), f"{where} ({shape['label']!r})")


def read_points(value: object, where: str) -> Float[np.ndarray, "N 2"]:
    """Give a list of [x, y] as an array; a bounded number of finite numbers within reason."""
    if isinstance(value, list) and len(value) > MOST_POINTS:
        raise PuppetError(f"{where}: {len(value)} points; at most {MOST_POINTS}")
    try:
        points = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] != 2 or not (np.abs(points) <= FARTHEST).all():
        raise PuppetError(f"{where}: expected 'points' as a list of [x, y]")
    return points


def _ring(label: str, kind: str, points: Float[np.ndarray, "N 2"], where: str) -> Float[np.ndarray, "M 2"]:
    if kind == "polygon":
        return points
    if kind == "rectangle" and len(points) in (2, 4):
        (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
        return np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    if kind == "circle" and len(points) == 2:
        radius = math.dist(points[0], points[1])
        angle = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_POINTS, endpoint=False)
        ring: Float[np.ndarray, "M 2"] = points[0] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return ring
    raise PuppetError(f"{where} ({label!r}) is a {kind!r}; draw parts as polygons and hinges as points")


def _joint(label: str, points: Float[np.ndarray, "N 2"], where: str) -> JointSpec:
    names = hinge_names(label)
    if names is None or len(points) != 1:
        raise PuppetError(f"{where}: a hinge is one point labelled with two parts, like 'torso+head'; found {label!r}")
    return JointSpec(names, (float(points[0, 0]), float(points[0, 1])))


def hinge_names(label: str) -> tuple[str, str] | None:
    """Split ``torso+head``; None where a label names no hinge."""
    names = tuple(name.strip() for name in label.split("+"))
    return (names[0], names[1]) if len(names) == 2 and all(names) else None
