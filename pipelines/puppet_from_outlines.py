"""`wildpuppet puppet from-outlines`: cut a puppet out of one frame along outlines, as the paper does."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Arguments:
    """Cut a puppet out of one frame along outlines: one polygon per part, back to front.

    What a part in front hides is filled in behind it. A point (LabelMe) or shape (SVG) named a+b is the hinge of the
    parts a and b.
    """

    frame: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FRAME.png")]
    """The picture that the outlines were drawn on."""
    outlines: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUTLINES.svg|json")]
    """SVG, LabelMe or COCO."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The puppet folder to write; new or empty."""
    reference: Annotated[int | None, tyro.conf.arg(metavar="FRAME")] = None
    """The frame's number in its clip."""
    halo: Annotated[int | None, tyro.conf.arg(metavar="PIXELS")] = None
    """Pixels beside a part in front that are not believed: 0 clean vector art, 1 clean video, 3 compressed video."""


def main(arguments: Arguments) -> None:
    """Read, cut, write, tell."""
    from wildpuppet.puppet.imports.formats import recognised
    from wildpuppet.puppet.imports.from_frame import read_outlined

    from .puppet_written import require_room, tell, written

    require_room(arguments.out)
    name = recognised(arguments.outlines)
    imported = read_outlined(arguments.outlines, name, arguments.frame, arguments.reference, arguments.halo)
    written(imported, arguments.out)
    tell(imported, arguments.out)
