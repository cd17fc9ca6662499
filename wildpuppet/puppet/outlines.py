"""Cut a puppet out of one drawing along outlines that a person drew: the paper's way of making a puppet.

A person outlines the parts on one frame, back to front, in any tool that writes LabelMe's JSON. Each part becomes an
image of the canvas's size: alpha is the outline's exact coverage (a ramp of about one pixel), colour is the frame's
where nothing in front hides the part, and is **completed** from the part's own visible pixels everywhere else, so that
a limb that moves away uncovers its neighbour and not a picture of itself. Colour also runs on for a few pixels outside
the outline; no background can leak in when the part is resampled.

Neural Puppet (Poursaeed et al., WACV 2020), section 3.2. Outlines are in frame pixels, corner origin.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import distance_transform_edt

from wildpuppet.errors import PuppetError
from wildpuppet.types import CutOut, JointSpec, Part

_SUBPIXELS = 8
"""Coverage is counted on this many samples per pixel side: 64 levels of alpha, finer than any drawn edge."""


@dataclass(frozen=True, eq=False)
class Outline:
    """One part's polygon in frame pixels (corner origin), at least three points, either direction, not repeated."""

    name: str
    points: Float[np.ndarray, "N 2"]


@dataclass(frozen=True, eq=False)
class Outlines:
    """What an outline file says: parts back to front, hinges, the frame's size and its number where known."""

    parts: tuple[Outline, ...]
    joints: tuple[JointSpec, ...] = ()
    canvas: tuple[int, int] | None = None
    reference: int | None = None


def cutout_from_outlines(
    frame_rgb: UInt8[np.ndarray, "H W 3"], outlines: Outlines, *, bleed: int = 6, halo: int = 2
) -> CutOut:
    """Cut every outlined part out of the frame and complete what the parts in front hide.

    ``bleed`` is how many pixels the colour runs on outside a part's outline. ``halo`` is how many pixels beside a part
    in front are not believed to be this part's own colour; over as many more the frame's colour fades in, and the
    completion borrows from pixels that far from any edge. Raise it where edges are soft or the video is badly
    compressed (about 3), lower it to 0 for clean vector art. Raises PuppetError where outlines contradict the frame or
    one another, or where a part shows no pixel of its own to complete it from.
    """
    height, width = frame_rgb.shape[:2]
    _check_outlines(outlines, (width, height))
    coverage = [polygon_coverage(part.points, (width, height)) for part in outlines.parts]
    parts = []
    for index, outline in enumerate(outlines.parts):
        in_front = np.max([np.zeros((height, width)), *coverage[index + 1 :]], axis=0) > 0
        trust = _trust(coverage[index] >= 1, in_front, halo)
        if not (trust >= 1).any():
            raise PuppetError(
                f"part {outline.name!r} shows no pixel of its own: parts in front hide it or its outline has no "
                "inside; move it forwards in the order or draw it larger"
            )
        rgb = complete_colour(frame_rgb, trust, coverage[index] >= 1, inset=halo)
        rgb = bleed_colour(rgb, coverage[index] >= 1, bleed)
        alpha = np.rint(255 * coverage[index]).astype(np.uint8)
        parts.append(Part(outline.name, np.dstack([rgb, alpha])))
    return CutOut((width, height), tuple(parts), outlines.joints, outlines.reference)


def polygon_coverage(points: Float[np.ndarray, "N 2"], canvas: tuple[int, int]) -> Float[np.ndarray, "H W"]:
    """Measure which share of each pixel lies inside a polygon (0..1); what is outside the canvas is cut off."""
    width, height = canvas
    coverage = np.zeros((height, width))
    low = np.clip(np.floor(points.min(0)).astype(int) - 1, 0, canvas)
    high = np.clip(np.ceil(points.max(0)).astype(int) + 1, 0, canvas)
    if (high <= low).any():
        return coverage
    columns, rows = (high - low) * _SUBPIXELS
    inside = np.zeros((rows, columns), np.uint8)
    cv2.fillPoly(inside, [_shrunk_for_opencv((points - low) * _SUBPIXELS)], 1, cv2.LINE_8, shift=4)
    shares = inside.reshape(high[1] - low[1], _SUBPIXELS, high[0] - low[0], _SUBPIXELS).mean((1, 3))
    coverage[low[1] : high[1], low[0] : high[0]] = shares
    return coverage


def complete_colour(
    image: UInt8[np.ndarray, "H W 3"],
    trust: Float[np.ndarray, "H W"],
    is_wanted: Bool[np.ndarray, "H W"],
    *,
    inset: int = 0,
) -> UInt8[np.ndarray, "H W 3"]:
    """Keep the trusted pixels (1), replace the others (0) by the nearest trusted colour, smoothed; mix in between.

    Trusted pixels within ``inset`` of the others are kept but lend no colour (edges are polluted by what lies beside
    them), unless none are left without them. The smoothing grows with the distance to what is known, so that a fill
    is crisp at its edge and has no streaks far from it. What is not wanted comes back as it was. Raises ValueError
    where no pixel is trusted.
    """
    if not (trust >= 1).any():
        raise ValueError("complete_colour needs at least one trusted pixel")
    is_source = ~_grown(trust < 1, inset)
    if not is_source.any():
        is_source = trust >= 1
    rows, columns = np.nonzero(is_wanted | is_source)
    window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    share = (trust * is_wanted + ~is_wanted)[window][..., None]
    completed = image.copy()
    completed[window] = np.rint(share * image[window] + (1 - share) * _filled(image[window], is_source[window]))
    return completed


def bleed_colour(
    image: UInt8[np.ndarray, "H W 3"], is_inside: Bool[np.ndarray, "H W"], pixels: int
) -> UInt8[np.ndarray, "H W 3"]:
    """Run the inside's nearest colour on over the next ``pixels`` outside; what lies beyond is 0."""
    rows, columns = np.nonzero(_grown(is_inside, pixels))
    nearest_rows, nearest_columns = distance_transform_edt(~is_inside, return_distances=False, return_indices=True)
    bled = np.zeros_like(image)
    bled[rows, columns] = image[nearest_rows[rows, columns], nearest_columns[rows, columns]]
    return bled


def read_outlines(path: Path | str) -> Outlines:
    """Read LabelMe JSON: each polygon is a part (file order = back to front), each point named ``a+b`` is a hinge.

    ``imageWidth`` and ``imageHeight`` give the canvas; a top-level ``reference`` gives the frame number (LabelMe keeps
    it). Raises PuppetError with the shape's number where a shape cannot be used.
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
    width, height, reference = (tree.get(key) for key in ("imageWidth", "imageHeight", "reference"))
    canvas = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    return Outlines(tuple(parts), tuple(joints), canvas, reference if isinstance(reference, int) else None)


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


def _shrunk_for_opencv(points: Float[np.ndarray, "N 2"]) -> np.ndarray:
    """Turn sample coordinates (corner origin) into OpenCV's fixed point (4 bits, sample centres on integers)."""
    return np.rint((points - 0.5) * 16).astype(np.int32)


def _grown(mask: Bool[np.ndarray, "H W"], pixels: int) -> Bool[np.ndarray, "H W"]:
    """Grow a mask by a disc."""
    if pixels <= 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * pixels + 1, 2 * pixels + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc), dtype=bool)


def _trust(
    is_inside: Bool[np.ndarray, "H W"], in_front: Bool[np.ndarray, "H W"], halo: int
) -> Float[np.ndarray, "H W"]:
    """Say how far a pixel can be believed to show the part: 0 under and near the parts in front, 1 away from them."""
    distance = distance_transform_edt(~in_front) if in_front.any() else np.full(in_front.shape, np.inf)
    trust: Float[np.ndarray, "H W"] = np.clip((distance - halo) / max(halo, 1), 0, 1) * is_inside
    return trust


def _filled(image: UInt8[np.ndarray, "H W 3"], is_known: Bool[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W 3"]:
    """Fill with the nearest known colour, blurred by half the distance to it."""
    distance, (rows, columns) = distance_transform_edt(~is_known, return_indices=True)
    nearest = image[rows, columns].astype(np.float32)
    sigmas = _blur_ladder(float(distance.max()) / 2)
    ladder = [nearest, *[cv2.GaussianBlur(nearest, (0, 0), sigma) for sigma in sigmas[1:]]]
    filled = nearest.copy()
    for (low, high), (sharp, soft) in zip(pairwise(sigmas), pairwise(ladder), strict=True):
        share = np.clip((distance / 2 - low) / (high - low), 0, 1)[..., None].astype(np.float32)
        filled += share * (soft - sharp)
    return np.asarray(np.clip(np.rint(filled), 0, 255), dtype=np.uint8)


def _blur_ladder(largest: float) -> Sequence[float]:
    """List 0, 1, 2, 4 ... up to at least ``largest``."""
    return [0.0, *[2.0**step for step in range(max(0, math.ceil(math.log2(max(largest, 1.0)))) + 1)]]
