"""`wildpuppet inbetween`: frames between two frames of a run, or between two pictures of its character."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from wildpuppet.errors import SettingsError

from .reporter import progress_of, terminal

if TYPE_CHECKING:
    from wildpuppet.api import Run
    from wildpuppet.remake.contact import Finish, Picture
    from wildpuppet.remake.inbetween import Inbetweens


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Draw inbetweens: the puppet between two frames of a run, at any size, with alpha.

    OUT/frames has the first key, the inbetweens and the last key as RGBA pictures; look at OUT/sheet.png, where each
    stands beside the drawing of the run that is most like it. OUT is itself a run: `wildpuppet export OUT` works.
    """

    sources: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="RUN | PICTURE PICTURE")]
    """OUT folder of a run, or two pictures of the character (then --model is needed)."""
    frames: Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="I J")] = None
    """The two frames of the run to go between."""
    count: int = 3
    """How many inbetweens."""
    method: Literal["ours", "hinges", "arap", "linear", "code"] | None = None
    """ours: parts turn about their hinges along curves that know the drawings around; hinges: the same without them;
    arap and linear: the baselines; code: the network's codes are mixed. code where --model is given, else ours."""
    model: Annotated[Path | None, tyro.conf.arg(metavar="MODEL")] = None
    """Folder of `wildpuppet train`."""
    size: int = 1024
    """Larger side of the frames, in pixels."""
    around: Literal["picture", "character"] = "picture"
    """What the frames show: all of the run's picture, so that they lie over it, or the character alone, larger."""
    refine: Annotated[Path | None, tyro.conf.arg(metavar="REFINER")] = None
    """Finish the rendered frames with what `wildpuppet refine` has learnt."""
    source: Annotated[Path | None, tyro.conf.arg(metavar="CLIP")] = None
    """Where the clip or the folder of drawings lies now, when it was moved."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the result; out/RUN-I-J when left out."""


def main(arguments: Arguments) -> None:
    """Check, make the poses, then draw them."""
    from wildpuppet.remake.contact import write_pictures
    from wildpuppet.remake.posed import check_made, write_posed

    out = _out_of(arguments)
    check_made(out, "inbetween")
    with terminal() as reporter:
        reporter.begin("poses")
        found, picture_of, finish = _made(arguments)
        reporter.end("poses", is_kept=False)
        reporter.begin("frames")

        def write(folder: Path) -> None:
            write_pictures(folder, found, progress_of(reporter), picture_of, finish)

        write_posed(out, found.posed, write)
        reporter.end("frames", is_kept=False)
    sys.stdout.write(f"{out}\nlook at {out / 'sheet.png'} first\n")


def _made(
    arguments: Arguments,
) -> "tuple[Inbetweens, Callable[[int], Picture] | None, Finish | None]":
    from wildpuppet.api import open_run
    from wildpuppet.models import load_model
    from wildpuppet.remake.shown import pictures_of_run

    method = arguments.method or ("ours" if arguments.model is None else "code")
    if len(arguments.sources) == 1:
        if arguments.frames is None:
            raise SettingsError("--frames is needed: the two frames of the run to go between, such as --frames 10 14")
        run = open_run(arguments.sources[0])
        model = None if arguments.model is None else load_model(arguments.model, run.puppet)
        found = run.inbetween(
            *arguments.frames,
            arguments.count,
            method,
            model,
            arguments.size,
            arguments.around == "character",
            arguments.source,
        )
        return found, pictures_of_run(run, arguments.source), _finish(arguments, run, found)
    return _between_pictures(arguments), None, None


def _between_pictures(arguments: Arguments) -> "Inbetweens":
    from wildpuppet.models import load_model
    from wildpuppet.remake.inbetween import inbetweens_of_pictures

    if len(arguments.sources) != 2:
        raise SettingsError(f"expected a RUN or two pictures, found {len(arguments.sources)} paths")
    if arguments.model is None:
        raise SettingsError("--model is needed to read two pictures; `wildpuppet train` makes one")
    if arguments.frames is not None or arguments.refine is not None:
        raise SettingsError("--frames and --refine go with a RUN; two pictures are the keys themselves")
    return inbetweens_of_pictures(
        arguments.sources,
        arguments.count,
        load_model(arguments.model),
        arguments.method or "code",
        arguments.size,
        arguments.around == "character",
    )


def _out_of(arguments: Arguments) -> Path:
    if arguments.out is not None:
        return arguments.out
    name = arguments.sources[0].resolve().name if arguments.sources else "inbetween"
    frames = "pictures" if arguments.frames is None else f"{arguments.frames[0]}-{arguments.frames[1]}"
    return Path("out") / f"{Path(name).stem}-{frames}"


def _finish(arguments: Arguments, run: "Run", found: "Inbetweens") -> "Finish | None":
    if arguments.refine is None or arguments.frames is None:
        return None
    from wildpuppet.refiners import load_refiner
    from wildpuppet.remake.finished import finish_with

    return finish_with(load_refiner(arguments.refine, run.puppet), run, found, arguments.frames[0])
