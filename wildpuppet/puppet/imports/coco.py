"""COCO annotations: one annotation per part over one frame, polygons or run-length masks.

A part is called by its category, numbered where a category occurs twice; the order of the annotations is back to
front.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.labelme import joined, read_points
from wildpuppet.puppet.imports.limits import MOST_PARTS, require_canvas
from wildpuppet.puppet.imports.result import own_name
from wildpuppet.puppet.outlines import Outline, Outlines, Stencil


def image_of(tree: dict[str, Any], path: Path, frame: Path | None) -> dict[str, Any]:
    """Choose the picture that the annotations are about: the only one, or the one named like ``frame``."""
    images = tree.get("images")
    if not isinstance(images, list) or not images or not all(isinstance(image, dict) for image in images):
        raise PuppetError(f"{path}: expected COCO JSON with a list 'images', found {type(images).__name__}")
    if len(images) == 1:
        found: dict[str, Any] = images[0]
        return found
    names = [str(image.get("file_name", "")) for image in images]
    matches = [image for image, name in zip(images, names, strict=True) if frame and Path(name).name == frame.name]
    if len(matches) != 1:
        raise PuppetError(
            f"{path}: annotates {len(images)} pictures ({', '.join(names[:3])}, ...); say which with --frame FILE of "
            "that name"
        )
    chosen: dict[str, Any] = matches[0]
    return chosen


def outlines_of(tree: dict[str, Any], path: Path, image: dict[str, Any]) -> Outlines:
    """Take one picture's outlines from a COCO file's content."""
    width, height = image.get("width"), image.get("height")
    if not isinstance(width, int) or not isinstance(height, int):
        raise PuppetError(f"{path}: image {image.get('file_name')!r} has no whole width and height")
    require_canvas((width, height), 1, str(path))
    annotations = tree.get("annotations")
    if not isinstance(annotations, list):
        raise PuppetError(f"{path}: expected COCO JSON with a list 'annotations', found {type(annotations).__name__}")
    mine = [entry for entry in annotations if isinstance(entry, dict) and entry.get("image_id") == image.get("id")]
    require_canvas((width, height), len(mine), str(path))
    names, taken = _categories(tree), set[str]()
    parts = [
        _part(entry, own_name(names.get(str(entry.get("category_id")), "part"), taken), (width, height), path)
        for entry in mine
    ]
    return Outlines(tuple(parts), (), (width, height))


def _categories(tree: dict[str, Any]) -> dict[str, str]:
    categories = tree.get("categories")
    found = [entry for entry in categories if isinstance(entry, dict)] if isinstance(categories, list) else []
    return {str(entry.get("id")): str(entry.get("name") or "part") for entry in found}


def _part(entry: dict[str, Any], name: str, size: tuple[int, int], path: Path) -> Outline | Stencil:
    where = f"{path}: annotation {str(entry.get('id'))[:20]} ({name!r})"
    area = entry.get("segmentation")
    if isinstance(area, dict):
        return Stencil(name, _unpacked(area, size, where))
    if not isinstance(area, list) or not area or len(area) > MOST_PARTS:
        raise PuppetError(f"{where}: expected 'segmentation' as polygons or a run-length mask")
    rings = [read_points(_pairs(flat, where), where) for flat in area]
    outline = Outline(name, rings[0])
    for ring in rings[1:]:
        outline = joined(outline, ring)
    return outline


def _pairs(flat: object, where: str) -> list[list[object]]:
    if not isinstance(flat, list) or len(flat) % 2 or len(flat) < 6:
        raise PuppetError(f"{where}: a polygon is a list x1, y1, x2, y2, ... of at least three points")
    return [[x, y] for x, y in zip(flat[0::2], flat[1::2], strict=True)]


def _unpacked(area: dict[str, Any], size: tuple[int, int], where: str) -> Bool[np.ndarray, "H W"]:
    """Unpack a run-length mask: columns first, counts of 0 and 1 in turn."""
    width, height = size
    if area.get("size") != [height, width]:
        raise PuppetError(f"{where}: mask of size {str(area.get('size'))[:40]}; expected [{height}, {width}]")
    counts = area.get("counts")
    if isinstance(counts, str):
        counts = _decompressed(counts, size, where)
    if not isinstance(counts, list) or not all(isinstance(run, int) and run >= 0 for run in counts):
        raise PuppetError(f"{where}: expected the mask's 'counts' as whole numbers or COCO's text")
    if sum(counts) != width * height:
        raise PuppetError(f"{where}: the mask's runs add up to {sum(counts)} pixels, the picture has {width * height}")
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape(width, height).T


def _decompressed(text: str, size: tuple[int, int], where: str) -> list[int]:
    """Read COCO's text form of run lengths: digits of five bits, every run a difference to the one before last."""
    runs: list[int] = []
    digits = iter(text.encode("ascii", "replace"))
    for code in digits:
        run, shift, digit = 0, 0, code - 48
        while digit & 0x20 and 0 <= digit < 64 and shift < 60:
            run |= (digit & 0x1F) << shift
            shift += 5
            digit = next(digits, 48) - 48
        if not 0 <= digit < 64:
            raise PuppetError(f"{where}: the mask's counts hold what is no run length")
        run |= (digit & 0x1F) << shift
        if digit & 0x10:
            run -= 1 << (shift + 5)
        if len(runs) > 2:
            run += runs[-2]
        runs.append(run)
        if run < 0 or len(runs) > size[0] * size[1] + 1:
            raise PuppetError(f"{where}: the mask's counts do not fit the picture")
    return runs
