"""Outlines over one frame, from SVG, LabelMe or COCO: find the frame, cut the parts out, complete what is hidden."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports import coco, labelme, svg
from wildpuppet.puppet.imports.hinges import completed
from wildpuppet.puppet.imports.limits import Rgba, inside, read_json, read_picture, require_canvas
from wildpuppet.puppet.imports.result import Imported
from wildpuppet.puppet.outlines import Outlines, cutout_from_outlines

Reader = Callable[[Path, Path | None], Imported]


@dataclass(frozen=True, eq=False)
class Drawn:
    """Outlines and the frame that they were drawn on."""

    rgb: UInt8[np.ndarray, "H W 3"]
    outlines: Outlines
    notes: tuple[str, ...] = ()


def read_svg(path: Path, frame: Path | None) -> Imported:
    """Read outlines in SVG; without ``frame`` the picture that the SVG embeds or links to."""
    return cut(drawn_svg(path, frame), path)


def read_labelme(path: Path, frame: Path | None) -> Imported:
    """Read LabelMe outlines; without ``frame`` the picture inside the file or the one that it names."""
    return cut(drawn_labelme(path, frame), path)


def read_coco(path: Path, frame: Path | None) -> Imported:
    """Read COCO outlines; without ``frame`` the picture that the file names, if it lies in its folder."""
    return cut(drawn_coco(path, frame), path)


def drawn_svg(path: Path, frame: Path | None) -> Drawn:
    """Read an SVG and its frame."""
    drawing = svg.read_drawing(path)
    rgb = _required(_frame(frame) if frame else svg.linked_frame(drawing, path), path)
    outlines = svg.outlines_of(drawing, (rgb.shape[1], rgb.shape[0]), path)
    if not any(found.name or found.group for found in drawing.found):
        drawing.notes.append("no shape bears a name; name each (in Inkscape its label), and save as Inkscape SVG")
    return Drawn(rgb, outlines, tuple(drawing.notes))


def drawn_labelme(path: Path, frame: Path | None) -> Drawn:
    """Read a LabelMe file and its frame."""
    tree = read_json(path)
    outlines = labelme.outlines_of(tree, path)
    picture = _frame(frame) if frame else labelme.embedded_frame(tree, path)
    return Drawn(_required(_named_frame(path, tree.get("imagePath")) if picture is None else picture, path), outlines)


def drawn_coco(path: Path, frame: Path | None) -> Drawn:
    """Read a COCO file and its frame."""
    tree = read_json(path)
    image = coco.image_of(tree, path, frame)
    outlines = coco.outlines_of(tree, path, image)
    return Drawn(_required(_frame(frame) if frame else _named_frame(path, image.get("file_name")), path), outlines)


def read_outlined(path: Path, name: str, frame: Path, reference: int | None, halo: int | None) -> Imported:
    """Read outlines of a known format over a frame; ``reference`` and ``halo`` overrule what the file says."""
    readers = {"svg": drawn_svg, "labelme": drawn_labelme, "coco": drawn_coco}
    if name not in readers:
        raise PuppetError(f"{path}: a {name}, no outlines; expected SVG, LabelMe or COCO (or wildpuppet puppet import)")
    if min(reference or 0, halo or 0) < 0 or (halo or 0) > 100:
        raise PuppetError(
            f"--reference {reference}, --halo {halo}: expected 0 or more, and a halo of at most 100 pixels"
        )
    drawn = readers[name](path, frame)
    outlines = drawn.outlines
    if reference is not None:
        outlines = replace(outlines, reference=reference)
    if halo is not None:
        outlines = replace(outlines, halo=halo)
    return cut(replace(drawn, outlines=outlines), path)


def cut(drawn: Drawn, path: Path) -> Imported:
    """Cut outlined parts out of their frame and add the hinges that are missing."""
    height, width = drawn.rgb.shape[:2]
    require_canvas((width, height), max(len(drawn.outlines.parts), 1), str(path))
    cutout = cutout_from_outlines(drawn.rgb, drawn.outlines)
    hinges, words = completed(cutout.parts, cutout.joints, [()] * len(cutout.parts))
    return Imported(replace(cutout, joints=hinges), (*drawn.notes, *words))


def _frame(path: Path) -> Rgba:
    return read_picture(path, str(path))


def _named_frame(path: Path, name: object) -> Rgba | None:
    """Read the picture that an outline file names, where it lies in the same folder."""
    if not isinstance(name, str) or not name:
        return None
    beside = inside(path.parent, name, f"{path}: its picture")
    return read_picture(beside, str(beside)) if beside.is_file() else None


def _required(picture: Rgba | None, path: Path) -> UInt8[np.ndarray, "H W 3"]:
    """Give the frame's colours; what is transparent in it becomes white."""
    if picture is None:
        raise PuppetError(f"{path}: the frame that the outlines were drawn on is not in it; add --frame FRAME.png")
    alpha = picture[..., 3:].astype(np.float64) / 255.0
    return np.rint(picture[..., :3] * alpha + 255.0 * (1.0 - alpha)).astype(np.uint8)
