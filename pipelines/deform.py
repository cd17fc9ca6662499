"""`wildpuppet deform`: drag points of one frame's puppet; the rest follows."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from wildpuppet.errors import SettingsError

from .reporter import terminal

if TYPE_CHECKING:
    from wildpuppet.api import Run
    from wildpuppet.remake.deform import Deformed, Picture


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Drag points of the puppet in one frame of a run; the rest follows as it did in the run's other frames.

    OUT/deformed.png is the puppet alone (RGBA, the video's size), OUT/preview.png the handles before and after,
    OUT/meshes.npz the vertices. OUT is itself a run of one frame: `wildpuppet export OUT` works.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    frame: Annotated[int, tyro.conf.arg(metavar="FRAME")]
    """Frame of the run that is dragged."""
    handle: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="PART:X,Y->X,Y")] = ()
    """A point of a part as it stands in the frame, and where it is to go, in video pixels, in quotes:
    --handle "hand:120,80->150,60". PART:@X,Y->X,Y gives the point on the puppet at rest (canvas pixels), for hidden
    parts. Give one for each point; one whose target is where it is keeps it there."""
    model: Annotated[Path | None, tyro.conf.arg(metavar="MODEL")] = None
    """Folder of `wildpuppet train`: its codes are moved. Left out, hinge rotations of the run's own frames are."""
    over: Literal["none", "white", "original", "plate"] = "none"
    """Also write OUT/over.png: the puppet over white, over the frame as it is, or over the background without the
    character (which costs a pass over the clip)."""
    source: Annotated[Path | None, tyro.conf.arg(metavar="CLIP")] = None
    """Where the clip or the folder of drawings lies now, when it was moved."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the result; out/RUN-FRAME-deformed when left out."""


def main(arguments: Arguments) -> None:
    """Check, drag, write."""
    from wildpuppet.api import open_run
    from wildpuppet.models import load_model
    from wildpuppet.remake.deform import handle_from
    from wildpuppet.remake.posed import check_made, write_posed

    if not arguments.handle:
        raise SettingsError('--handle is needed: part:x,y->x,y, such as --handle "hand:120,80->150,60"')
    handles = [handle_from(text) for text in arguments.handle]
    run = open_run(arguments.run)
    out = arguments.out or Path("out") / f"{arguments.run.resolve().name}-{arguments.frame}-deformed"
    check_made(out, "deform")
    with terminal() as reporter:
        reporter.begin("deform")
        model = None if arguments.model is None else load_model(arguments.model, run.puppet)
        found = run.deform(arguments.frame, handles, model, arguments.source)
        write_posed(out, found.posed, lambda folder: _write(folder, run, found, arguments))
        reporter.end("deform", is_kept=False)
    moved = float(np.linalg.norm(found.vertices - found.before, axis=1).max())
    sys.stdout.write(f"{out}: {len(handles)} handles met, vertices moved by up to {moved:.0f} pixels\n")
    sys.stdout.write(f"look at {out / 'preview.png'} first\n")


def _write(folder: Path, run: "Run", found: "Deformed", arguments: Arguments) -> None:
    from PIL import Image

    from wildpuppet.export.draw import Painter
    from wildpuppet.remake.deform import preview
    from wildpuppet.remake.shown import PAPER, pictures_of_run

    rgba = Painter(found.posed.animation).picture(found.posed.animation[0])
    Image.fromarray(rgba).save(folder / "deformed.png")
    picture_of = pictures_of_run(run, arguments.source)
    width, height = run.size
    paper = np.full((height, width, 3), PAPER, np.uint8)
    Image.fromarray(preview(found, paper if picture_of is None else picture_of(arguments.frame))).save(
        folder / "preview.png"
    )
    if arguments.over != "none":
        Image.fromarray(_laid(rgba, _behind(run, arguments))).save(folder / "over.png")


def _behind(run: "Run", arguments: Arguments) -> "Picture":
    """Give what shows behind the puppet."""
    from wildpuppet.export.source import source_of
    from wildpuppet.recut import clip_of_run, is_clip, source_of_run

    width, height = run.size
    if arguments.over == "white":
        return np.full((height, width, 3), 255, np.uint8)
    place = clip_of_run(run, arguments.source) if is_clip(run) else source_of_run(run, arguments.source)
    picture = source_of(place).picture(arguments.frame)
    return picture if arguments.over == "original" else _without(run, arguments, picture)


def _without(run: "Run", arguments: Arguments, picture: "Picture") -> "Picture":
    """Take the character out of the frame."""
    from wildpuppet.export.draw import Painter
    from wildpuppet.machine import Machine
    from wildpuppet.paint.behind import Behind, Paper
    from wildpuppet.paint.layers import Drawn
    from wildpuppet.recut import clip_of_run, is_clip, track_of

    animation, crops = run.animation, run.crops
    row = int(np.flatnonzero(run.fit.frames == arguments.frame)[0])
    shown = Painter(animation).picture(animation[row]).astype(np.float32) / 255.0
    shape, everywhere = picture.shape[:2], (slice(0, picture.shape[0]), slice(0, picture.shape[1]))
    drawn = Drawn(everywhere, shown, shown, np.full(shape, -1), np.zeros(shape, bool))
    if not is_clip(run):
        return Paper().picture(row, picture, drawn)
    crop_from_video = 1.0 / float(crops.video_from_crop[crops.reference or 0, 0, 0])
    behind = Behind(clip_of_run(run, arguments.source), track_of(crops), crop_from_video, Machine())
    return behind.picture(row, picture, drawn)


def _laid(rgba: np.ndarray, picture: "Picture") -> "Picture":
    alpha = rgba[..., 3:].astype(np.float32) / 255.0
    return np.asarray(np.rint(rgba[..., :3] * alpha + picture * (1.0 - alpha)), np.uint8)
