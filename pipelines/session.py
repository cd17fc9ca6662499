"""What every command that runs stages shares: its options, opening the store, the note, the end of a run."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import tyro

from wildpuppet.errors import SettingsError
from wildpuppet.machine import Device, Machine
from wildpuppet.runs import read_run
from wildpuppet.settings import Settings, settings_from
from wildpuppet.stages import NAMES
from wildpuppet.store import Store

from .keeper import Keeper, ReachedEnd
from .outcome import Outcome, in_short, write_outcome
from .reporter import Reporter
from .request import Request

STORE = Path(".wildpuppet")
"""The default store, in the working directory: seen, and gone with the project it belongs to."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to run stages."""

    config: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = ""
    """Preset: fast, paper, or a TOML file. Settings given as flags win over it."""
    store: Annotated[Path, tyro.conf.arg(metavar="DIR")] = STORE
    """Folder of kept results: stages that are in it do not run again."""
    until: Annotated[str | None, tyro.conf.arg(metavar="STAGE")] = None
    """Last stage to run: probe, track, crop, puppet, place, search, choose, fit or meshes; OUT is not written then."""
    redo: Annotated[str | None, tyro.conf.arg(metavar="STAGE")] = None
    """Stage to run again although its result is kept; what follows runs again where that comes out differently."""
    device: Device = "auto"
    """auto takes CUDA where there is one."""
    settings: Annotated[Settings, tyro.conf.arg(name="")] = field(default_factory=Settings)

    def checked_settings(self) -> Settings:
        """Give the settings with their ranges checked, which constructors do not do."""
        return settings_from(msgspec.to_builtins(self.settings))


Pipeline = Callable[[Keeper, Request], Outcome]


def run_pipeline(pipeline: Pipeline, request: Request, options: Options, reporter: Reporter) -> bool:
    """Run a pipeline to its end or to ``--until``; give whether OUT was written."""
    for flag, name in (("--until", options.until), ("--redo", options.redo)):
        if name is not None and name not in NAMES:
            raise SettingsError(f"{flag} {name}: expected one of {', '.join(NAMES)}")
    machine = Machine(device=options.device)
    if options.device == "cuda":
        check_cuda(machine)
    keeper = Keeper(Store(options.store), request.settings, machine, reporter, until=options.until, redo=options.redo)
    keeper.noted_as(request.note_name, {"out": str(request.out.absolute()), "request": request.plain()})
    try:
        outcome = pipeline(keeper, request)
    except ReachedEnd:
        return False
    write_outcome(keeper, request, outcome)
    keeper.finish()
    return True


def check_cuda(machine: Machine) -> None:
    """Raise InputError where there is no CUDA device, before any work is done."""
    from wildpuppet.deform.learn import device_of

    device_of(machine)


def tell_end(out: Path, stopped_after: str | None) -> None:
    """Say in a line or two how a run went and what to look at."""
    if stopped_after:
        sys.stdout.write(f"stopped after {stopped_after}; {out} is not written\n")
        return
    sheet = out / "sheet.png"
    sys.stdout.write(f"{out}: {in_short(read_run(out))}\n" + (f"look at {sheet} first\n" if sheet.is_file() else ""))
