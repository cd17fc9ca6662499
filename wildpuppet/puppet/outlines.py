"""Cut a puppet out of one drawing along outlines that a person drew: the paper's way of making a puppet.

A person outlines the parts on one frame, back to front, in any tool that writes LabelMe's JSON. Each part becomes an
image of the canvas's size: alpha is the outline's exact coverage (a ramp of about one pixel), colour is the frame's
where nothing in front hides the part, and is **completed** from the part's own visible pixels everywhere else, so that
a limb that moves away uncovers its neighbour and not a picture of itself. Colour also runs on for a few pixels outside
the outline; no background can leak in when the part is resampled.

Neural Puppet (Poursaeed et al., WACV 2020), section 3.2. Outlines are in frame pixels, corner origin.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import distance_transform_edt

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.complete import bleed_colour, complete_colour
from wildpuppet.types import CutOut, JointSpec, Part

_SCAN_LINES = 8
"""Scan lines per pixel that coverage is the mean of; with exact columns this is finer than any drawn edge."""


@dataclass(frozen=True, eq=False)
class Outline:
    """One part's polygon in frame pixels (corner origin), at least three points, either direction, not repeated."""

    name: str
    points: Float[np.ndarray, "N 2"]


@dataclass(frozen=True, eq=False)
class Outlines:
    """What an outline file says: parts back to front, hinges, the frame's size and its number where known.

    ``halo`` is how many pixels beside a part in front are not believed to be a part's own colour; over as many more the
    frame's colour fades in, and the completion borrows from pixels that far from any edge. 0 for clean vector art, 1
    for clean video, 3 for compressed video with soft edges.
    """

    parts: tuple[Outline, ...]
    joints: tuple[JointSpec, ...] = ()
    canvas: tuple[int, int] | None = None
    reference: int | None = None
    halo: int = 1


def cutout_from_outlines(frame_rgb: UInt8[np.ndarray, "H W 3"], outlines: Outlines, *, bleed: int = 6) -> CutOut:
    """Cut every outlined part out of the frame and complete what the parts in front hide.

    ``bleed`` is how many pixels the colour runs on outside a part's outline. Raises PuppetError where outlines
    contradict the frame or one another, or where a part shows no pixel of its own to complete it from.
    """
    height, width = frame_rgb.shape[:2]
    _check_outlines(outlines, (width, height))
    coverage = [polygon_coverage(part.points, (width, height)) for part in outlines.parts]
    parts = []
    for index, outline in enumerate(outlines.parts):
        in_front = np.max([np.zeros((height, width)), *coverage[index + 1 :]], axis=0) > 0
        trust = _trust(coverage[index] >= 1, in_front, outlines.halo)
        if not (trust >= 1).any():
            raise PuppetError(
                f"part {outline.name!r} shows no pixel of its own: parts in front hide it or its outline has no "
                "inside; move it forwards in the order or draw it larger"
            )
        rgb = complete_colour(frame_rgb, trust, coverage[index] >= 1, inset=outlines.halo)
        rgb = bleed_colour(rgb, coverage[index] >= 1, bleed)
        alpha = np.rint(255 * coverage[index]).astype(np.uint8)
        parts.append(Part(outline.name, np.dstack([rgb, alpha])))
    return CutOut((width, height), tuple(parts), outlines.joints, outlines.reference)


def polygon_coverage(points: Float[np.ndarray, "N 2"], canvas: tuple[int, int]) -> Float[np.ndarray, "H W"]:
    """Measure which share of each pixel lies inside a polygon (0..1); what is outside the canvas is cut off.

    Even-odd rule. Exact along x; along y the mean of a few scan lines per pixel.
    """
    width, height = canvas
    coverage = np.zeros((height, width))
    left, top = np.clip(np.floor(points.min(0)).astype(int), 0, canvas)
    right, bottom = np.clip(np.ceil(points.max(0)).astype(int), 0, canvas)
    if right <= left or bottom <= top:
        return coverage
    scan_y = top + (np.arange((bottom - top) * _SCAN_LINES) + 0.5) / _SCAN_LINES
    columns = np.arange(left, right)
    inside = np.zeros((len(scan_y), len(columns)))
    crossings = _crossings(points, scan_y)
    for start, stop in zip(crossings[:, 0::2].T, crossings[:, 1::2].T, strict=True):
        inside += np.clip(stop[:, None] - columns, 0, 1) - np.clip(start[:, None] - columns, 0, 1)
    coverage[top:bottom, left:right] = inside.reshape(bottom - top, _SCAN_LINES, -1).mean(1)
    return coverage


def read_outlines(path: Path | str) -> Outlines:
    """Read LabelMe JSON: each polygon is a part (file order = back to front), each point named ``a+b`` is a hinge.

    ``imageWidth`` and ``imageHeight`` give the canvas. Two fields of ours at the top level, which LabelMe keeps:
    ``reference``, the frame's number, and ``halo`` (see Outlines). Raises PuppetError with the shape's number where a
    shape cannot be used.
    """
    path = Path(path)
    tree = _read_json(path)
    shapes = tree.get("shapes")
    if not isinstance(shapes, list):
        raise PuppetError(f"{path}: expected LabelMe JSON with a list 'shapes', found {type(shapes).__name__}")
    parts, joints = [], []
    for number, shape in enumerate(shapes):
        where = f"{path}: shape {number}"
        label, kind, points = _read_shape(shape, where)
        if kind == "polygon":
            parts.append(Outline(label, points))
        elif kind == "point":
            joints.append(_joint(label, points, where))
        else:
            raise PuppetError(f"{where} ({label!r}) is a {kind!r}; draw parts as polygons and hinges as points")
    width, height = _read_count(tree, "imageWidth", path), _read_count(tree, "imageHeight", path)
    canvas = None if width is None or height is None else (width, height)
    reference, halo = _read_count(tree, "reference", path), _read_count(tree, "halo", path)
    return Outlines(tuple(parts), tuple(joints), canvas, reference, Outlines.halo if halo is None else halo)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PuppetError(f"cannot read outlines {path}: {error.strerror}") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise PuppetError(f"{path} is not JSON ({error}); expected a file saved by LabelMe") from None
    if not isinstance(tree, dict):
        raise PuppetError(f"{path}: expected LabelMe JSON (an object with 'shapes'), found {type(tree).__name__}")
    return tree


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
    try:
        points = np.array(shape.get("points"), dtype=np.float64)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise PuppetError(f"{where} ({shape['label']!r}): expected 'points' as a list of [x, y]")
    return shape["label"], shape.get("shape_type") or "polygon", points


def _joint(label: str, points: Float[np.ndarray, "N 2"], where: str) -> JointSpec:
    names = tuple(name.strip() for name in label.split("+"))
    if len(names) != 2 or not all(names) or len(points) != 1:
        raise PuppetError(f"{where}: a hinge is one point labelled with two parts, like 'torso+head'; found {label!r}")
    return JointSpec((names[0], names[1]), (float(points[0, 0]), float(points[0, 1])))


def _check_outlines(outlines: Outlines, size: tuple[int, int]) -> None:
    if outlines.canvas is not None and outlines.canvas != size:
        raise PuppetError(
            f"the outlines were drawn on a {outlines.canvas[0]}x{outlines.canvas[1]} picture, the frame is "
            f"{size[0]}x{size[1]}; use the frame they were drawn on"
        )
    if not outlines.parts:
        raise PuppetError("expected at least one outlined part, found none; draw one polygon per part")
    names = [outline.name for outline in outlines.parts]
    for name in names:
        if names.count(name) > 1:
            raise PuppetError(f"two outlines are named {name!r}; give each part its own name")
    for outline in outlines.parts:
        _check_points(outline, size)
    for joint in outlines.joints:
        unknown = [name for name in joint.parts if name not in names]
        if unknown or joint.parts[0] == joint.parts[1]:
            raise PuppetError(
                f"hinge {joint.parts[0]}+{joint.parts[1]} must name two different parts; "
                f"the parts are {', '.join(names)}"
            )


def _check_points(outline: Outline, size: tuple[int, int]) -> None:
    points = outline.points
    if len(points) < 3:
        raise PuppetError(f"part {outline.name!r} has {len(points)} points; an outline needs at least 3")
    if not np.isfinite(points).all():
        raise PuppetError(f"part {outline.name!r} has a point that is not a number; draw it again")
    if (points.max(0) <= 0).any() or (points.min(0) >= size).any():
        raise PuppetError(f"part {outline.name!r} lies wholly outside the {size[0]}x{size[1]} frame; move it inside")


def _crossings(points: Float[np.ndarray, "N 2"], scan_y: Float[np.ndarray, "S"]) -> Float[np.ndarray, "S K"]:
    """Find where each scan line crosses the polygon, ascending; K is even and short rows end in infinities."""
    after = np.roll(points, -1, axis=0)
    is_crossed = (points[:, 1] <= scan_y[:, None]) != (after[:, 1] <= scan_y[:, None])
    rise = np.where(after[:, 1] == points[:, 1], 1.0, after[:, 1] - points[:, 1])
    x = points[:, 0] + (scan_y[:, None] - points[:, 1]) * (after[:, 0] - points[:, 0]) / rise
    most = int(is_crossed.sum(1).max())
    crossings: Float[np.ndarray, "S K"] = np.sort(np.where(is_crossed, x, np.inf), axis=1)[:, :most]
    return crossings


def _trust(
    is_inside: Bool[np.ndarray, "H W"], in_front: Bool[np.ndarray, "H W"], halo: int
) -> Float[np.ndarray, "H W"]:
    """Say how far a pixel can be believed to show the part: 0 under and near the parts in front, 1 away from them."""
    distance = distance_transform_edt(~in_front) if in_front.any() else np.full(in_front.shape, np.inf)
    trust: Float[np.ndarray, "H W"] = np.clip((distance - halo) / max(halo, 1), 0, 1) * is_inside
    return trust
