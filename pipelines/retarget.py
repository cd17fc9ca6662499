"""`wildpuppet retarget`: the motion of a run's character on another puppet."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from wildpuppet.errors import SettingsError

from .reporter import progress_of, terminal

if TYPE_CHECKING:
    from wildpuppet.remake.retarget import Retargeted


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Put the motion of a run on another puppet: parts of the same name turn alike.

    OUT is itself a run, in the same picture and at the same times: `wildpuppet export OUT` works. Look at
    OUT/sheet.png first.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    to: Annotated[Path, tyro.conf.arg(metavar="PUPPET_DIR")]
    """Folder of the puppet that is to move."""
    height: float = 1.0
    """How tall it becomes, as a share of the character it follows; its way grows and shrinks with it."""
    match: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="MINE=THEIRS")] = ()
    """A part of the puppet and the part of the run that it follows, where their names differ. Give one for each."""
    source: Annotated[Path | None, tyro.conf.arg(metavar="CLIP")] = None
    """Where the clip or the folder of drawings lies now, when it was moved; it shows behind the preview."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the result; out/RUN-on-PUPPET when left out."""


def main(arguments: Arguments) -> None:
    """Check, carry the motion over, draw it, say which parts went together."""
    from wildpuppet.api import open_run
    from wildpuppet.remake.posed import check_made, write_posed
    from wildpuppet.remake.shown import pictures_of_run, write_shown

    run = open_run(arguments.run)
    name = f"{arguments.run.resolve().name}-on-{arguments.to.resolve().name}"
    out = arguments.out or Path("out") / name
    check_made(out, "retarget")
    with terminal() as reporter:
        reporter.begin("motion")
        found = run.retarget(arguments.to, arguments.height, _pairs(arguments.match))
        picture_of = pictures_of_run(run, arguments.source)
        reporter.end("motion", is_kept=False)
        reporter.begin("preview")

        def write(folder: Path) -> None:
            write_shown(folder, found.posed, picture_of, progress_of(reporter))

        write_posed(out, found.posed, write)
        reporter.end("preview", is_kept=False)
    sys.stdout.write(f"{out}: {_said(found)}\nlook at {out / 'sheet.png'} first\n")


def _pairs(words: tuple[str, ...]) -> dict[str, str]:
    """Split MINE=THEIRS."""
    pairs = {}
    for word in words:
        mine, sign, theirs = word.partition("=")
        if not (mine and sign and theirs):
            raise SettingsError(f"--match {word}: expected MINE=THEIRS, a part of the puppet and one of the run's")
        pairs[mine] = theirs
    return pairs


def _said(found: "Retargeted") -> str:
    """Say which parts went together and which did not."""
    words = [f"{len(found.pairs)} parts follow: {', '.join(name for _, name in found.pairs)}"]
    if found.match.at_rest:
        words.append(f"keep their drawn pose: {', '.join(found.match.at_rest)}")
    if found.match.unused:
        words.append(f"not used: {', '.join(found.match.unused)}")
    return "; ".join(words)
