"""`wildpuppet refine`: learn how the drawings look beside the rendered puppet, and finish every frame with it."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import tyro

from wildpuppet.errors import SettingsError
from wildpuppet.machine import Device, Machine
from wildpuppet.settings import RefineSettings

from .reporter import Reporter, terminal
from .train import Telling, frames_of

if TYPE_CHECKING:
    from wildpuppet.api import Run
    from wildpuppet.refine.refiner import Refiner


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Draw every frame of a run as it would have been drawn: shading, lines and details that one texture cannot have.

    Writes OUT/frames (RGBA pictures, preview, manifest) and OUT/refiner, which `wildpuppet inbetween --refine` takes.
    Stopped at any moment, the same command goes on where it was.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for the result: new, empty, or an earlier one, which is replaced unless you changed it."""
    refiner: Annotated[Path | None, tyro.conf.arg(metavar="REFINER")] = None
    """Use what another `wildpuppet refine` of this puppet learnt (its OUT/refiner); nothing is trained then."""
    over: Literal["none", "plate", "white"] = "none"
    """none: transparent around the character; plate: over the background without the character; white."""
    hold_out: Annotated[str, tyro.conf.arg(metavar="FRAMES")] = ""
    """Frames that nothing is learnt from, such as 3,5,8-12; the error on them is told."""
    source: Annotated[Path | None, tyro.conf.arg(metavar="CLIP")] = None
    """Where the clip or the folder of drawings lies now, when it was moved."""
    device: Device = "auto"
    """auto takes CUDA where there is one."""
    settings: Annotated[RefineSettings, tyro.conf.arg(name="")] = field(default_factory=RefineSettings)


def main(arguments: Arguments) -> None:
    """Learn, draw, and say how far the frames that were held out are from the drawings."""
    from wildpuppet.api import open_run
    from wildpuppet.finish import errors_of

    run = open_run(arguments.run)
    with terminal() as reporter:
        refiner = make(run, arguments, reporter)
    sys.stdout.write(f"{arguments.out / 'frames'}\n")
    if refiner.hold_out and arguments.refiner is None:
        rendered, refined = errors_of(refiner, run, refiner.hold_out, arguments.source)
        sys.stdout.write(
            f"mean squared error on the frames held out (0..255, over white): rendered {rendered:.1f}, "
            f"refined {refined:.1f}\n"
        )


def make(run: "Run", arguments: Arguments, reporter: Reporter) -> "Refiner":
    """Check everything that can be checked before the wait; learn or read the refiner; draw the frames."""
    from wildpuppet.finish import REFINER, check_finish_out, finish_run
    from wildpuppet.refine.refiner import check_settings
    from wildpuppet.refiners import kept_refiner, load_refiner, refiner_of_run

    from .session import check_cuda

    settings = checked(arguments.settings)
    check_settings(settings)
    check_finish_out(arguments.out)
    machine = Machine(device=arguments.device)
    check_cuda(machine)
    if arguments.refiner is not None and arguments.hold_out:
        raise SettingsError("--hold-out goes with training; a refiner that is given was trained before")
    hold_out, folder = frames_of(arguments.hold_out), arguments.out / REFINER
    reporter.begin("refiner")
    kept: Refiner | None
    if arguments.refiner is not None:
        kept = load_refiner(arguments.refiner, run.puppet)
    else:
        kept = kept_refiner(folder, run, settings, hold_out)
    telling = Telling(reporter)
    refiner = kept or refiner_of_run(run, settings, machine, hold_out, folder, arguments.source, telling)
    reporter.end("refiner", is_kept=kept is not None)
    reporter.begin("frames")

    def progress(done: int, total: int) -> None:
        reporter.update(done / max(total, 1))

    finish_run(run, refiner, arguments.out, arguments.over, arguments.source, progress)
    reporter.end("frames", is_kept=False)
    return refiner


def checked(settings: RefineSettings) -> RefineSettings:
    """Give settings with their ranges checked, which constructors do not do."""
    try:
        return msgspec.convert(msgspec.to_builtins(settings), RefineSettings)
    except msgspec.ValidationError as error:
        raise SettingsError(f"{str(error).replace('`', '').replace('$.', '')}; see wildpuppet refine --help") from None
