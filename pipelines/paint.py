"""`wildpuppet paint`: every frame of a run with a texture that a person painted on."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from wildpuppet.errors import SettingsError

from .reporter import terminal


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Paint once: edit the puppet's texture, get every frame with it.

    First `wildpuppet paint RUN --template paint.psd` (or a folder) writes what to paint on; then
    `wildpuppet paint RUN --texture paint.psd --out DIR` draws RGBA pictures, a preview and a manifest.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    texture: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER|FILE")] = None
    """What you painted on: a folder of part pictures, a PSD or ORA with the parts' names, or one PNG: the puppet at
    rest, RUN/atlas.png, or the frame that the puppet was drawn from."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the frames: new, empty, or with an earlier painting, which is replaced unless you changed it."""
    over: Literal["original", "plate", "none"] = "original"
    """original: the run's frames, in which only what was painted changes; plate: the whole puppet over the background
    without the character; none: the puppet alone, transparent around it."""
    template: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER|FILE")] = None
    """Write what to paint on: NAME.psd, NAME.ora, or a folder with a picture per part and one of the whole puppet."""
    source: Annotated[Path | None, tyro.conf.arg(metavar="CLIP")] = None
    """Where the clip or the folder of drawings lies now, when it was moved."""


def main(arguments: Arguments) -> None:
    """Write the template or paint."""
    from wildpuppet.api import open_run

    run = open_run(arguments.run)
    if arguments.template is not None:
        if arguments.texture is not None or arguments.out is not None:
            raise SettingsError("--template writes what to paint on; paint, then give --texture and --out")
        sys.stdout.write(f"{run.paint_template(arguments.template)}\n")
        return
    if arguments.texture is None or arguments.out is None:
        raise SettingsError("--texture and --out are needed; --template writes what to paint on")
    with terminal() as reporter:
        reporter.begin("paint")
        out = run.paint(
            arguments.texture,
            arguments.out,
            arguments.over,
            arguments.source,
            lambda done, total: reporter.update(done / max(total, 1)),
        )
        reporter.end("paint", is_kept=False)
    sys.stdout.write(f"{out}\n")
