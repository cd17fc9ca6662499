"""`wildpuppet export`: a finished run in the formats of other programs, one folder per format."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from wildpuppet.errors import SettingsError

from .reporter import Reporter, terminal

if TYPE_CHECKING:
    from wildpuppet.export.animation import Animation
    from wildpuppet.export.formats import Format
    from wildpuppet.export.options import Options


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Export a finished run; `wildpuppet formats` lists the formats. Each gets a folder OUT/FORMAT and a manifest.json.

    The manifest says what the files hold, where their zero is, what the format could not hold and how exact it is.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    to: Annotated[str, tyro.conf.arg(metavar="FORMAT[,FORMAT...]")]
    """Formats, separated by commas."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for the exports: new, empty, or with earlier exports, which are replaced unless you changed them."""
    first_frame: int | None = None
    """Number of the first exported frame in the files, such as 1001; by default the clip's own frame number."""
    units_per_pixel: float = 0.01
    """Length of one video pixel in formats of three dimensions."""
    picture_frame: int | None = None
    """Clip frame that formats of one picture (psd, ora) show; by default the puppet at rest."""
    pictures: bool = False
    """Put the clip's own frames into formats that carry them along (tapvid)."""


def main(arguments: Arguments) -> None:
    """Check everything that can be checked before the wait, then write format after format."""
    from wildpuppet.api import open_run
    from wildpuppet.export.export import check_out, check_unedited
    from wildpuppet.export.formats import formats_of
    from wildpuppet.export.options import Options

    if not 0.0 < arguments.units_per_pixel < float("inf"):
        raise SettingsError(f"--units-per-pixel {arguments.units_per_pixel:g}: expected a number above 0")
    if arguments.first_frame is not None and arguments.first_frame < 0:
        raise SettingsError(f"--first-frame {arguments.first_frame}: expected 0 or more; files are numbered by it")
    formats = formats_of(arguments.to)
    for each in formats:
        each.writer()
        check_unedited(arguments.out / each.name)
    check_out(arguments.out)
    run = open_run(arguments.run)
    options = Options(
        arguments.first_frame,
        arguments.units_per_pixel,
        arguments.picture_frame,
        run.pictures() if arguments.pictures else None,
    )
    with terminal() as reporter:
        for each in formats:
            folder = _export(run.animation, each, arguments.out, options, reporter)
            sys.stdout.write(f"{folder}\n")


def _export(animation: "Animation", each: "Format", out: Path, options: "Options", reporter: Reporter) -> Path:
    """Write one format and report how far it is."""
    from wildpuppet.export.export import export

    def progress(done: int, total: int) -> None:
        reporter.update(done / max(total, 1))

    reporter.begin(each.name)
    folder = export(animation, each, out, options, progress)
    reporter.end(each.name, is_kept=False)
    return folder
