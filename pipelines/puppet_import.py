"""`wildpuppet puppet import`: turn another tool's file into a puppet folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

From = Literal["psd", "ora", "png", "svg", "labelme", "coco", "animated-drawings", "dragonbones"]


@dataclass(frozen=True)
class Arguments:
    """Turn another tool's file or folder into a puppet folder.

    Layered PSD and ORA, a folder of RGBA PNGs, AnimatedDrawings characters and DragonBones rigs hold pictures of their
    own; SVG, LabelMe and COCO hold outlines, which are cut out of a frame.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE|FOLDER")]
    """What to import; its format is seen from its content."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The puppet folder to write; new or empty."""
    format: Annotated[From | None, tyro.conf.arg(name="from")] = None
    """Force the format."""
    frame: Annotated[Path | None, tyro.conf.arg(metavar="FRAME.png")] = None
    """The picture that outlines were drawn on, where the file does not hold or name it."""
    groups: Literal["apart", "merged"] = "apart"
    """merged: the layers of a group (lines, colours, shades) become one part (PSD, ORA)."""


def main(arguments: Arguments) -> None:
    """Read, write, tell."""
    from wildpuppet.puppet.imports.formats import read_puppet

    from .puppet_written import require_room, tell, written

    require_room(arguments.out)
    merge = arguments.groups == "merged"
    imported = read_puppet(arguments.source, arguments.format, arguments.frame, merge_groups=merge)
    written(imported, arguments.out)
    tell(imported, arguments.out)
