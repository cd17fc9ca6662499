"""`wildpuppet train`: a deformation network for one puppet, from a run or from a folder of drawings."""

import re
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
import tyro

from wildpuppet.errors import SettingsError
from wildpuppet.machine import Device
from wildpuppet.settings import Settings, TrainSettings, settings_from

from .arguments import value_of
from .presets import merged, read_preset
from .reporter import Reporter, Silent, note, terminal
from .session import STORE

if TYPE_CHECKING:
    from wildpuppet.deform.model import Model

NOTES = 10
"""Times that the losses are told."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Train a network that reads pictures of one puppet into codes and turns codes into meshes.

    Stopped at any moment, the same command goes on where it was.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN|FRAMES_DIR")]
    """OUT folder of a run, or a folder of drawings (with --puppet)."""
    out: Annotated[Path, tyro.conf.arg(metavar="MODEL")]
    """Folder for the model: new, empty, or an earlier model's."""
    puppet: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Puppet folder; a run brings its own, and a given one must be the same."""
    recipe: Literal["ours", "paper"] = "ours"
    """ours: the puppet's own renders in made-up poses and the fits of the frames; paper: Neural Puppet as printed, from
    the pictures alone (slow)."""
    hold_out: Annotated[str, tyro.conf.arg(metavar="FRAMES")] = ""
    """Frames that nothing is learnt from, such as 3,5,8-12."""
    config: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = ""
    """Preset: a name or a TOML file; its table [train], and where drawings are fitted first the rest."""
    store: Annotated[Path, tyro.conf.arg(metavar="DIR")] = STORE
    """Folder of kept results, where drawings are fitted first."""
    device: Device = "auto"
    """auto takes CUDA where there is one (recipe paper)."""
    settings: Annotated[Settings, tyro.conf.arg(name="")] = field(default_factory=Settings)


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the recipe's settings as defaults, so that a preset and explicit flags win."""
    settings = recipe_settings(value_of(argv, "--recipe") or "ours", value_of(argv, "--config"))
    return Arguments(source=tyro.MISSING, out=tyro.MISSING, settings=settings)


def recipe_settings(recipe: str, config: str) -> Settings:
    """Give a recipe's settings: its own for training unless a preset says something else of it."""
    from wildpuppet.deform.teach import OURS

    if recipe == "paper":
        return read_preset(config or "paper")
    settings = read_preset(config)
    is_said = settings.train != TrainSettings()
    return settings if is_said else msgspec.structs.replace(settings, train=OURS)


def main(arguments: Arguments) -> None:
    """Train, then say where the model is and what it has learnt from."""
    with terminal() as reporter:
        model = make(arguments, reporter)
    last = {name: float(values[-max(1, len(values) // 20) :].mean()) for name, values in model.losses.items()}
    found = f": {in_short(last)}" if last else " (kept: it was trained before)"
    sys.stdout.write(f"{arguments.out}{found}\n")


def make(arguments: Arguments, reporter: Reporter) -> "Model":
    """Train as asked, or read the model when this very training is done."""
    from wildpuppet.machine import Machine
    from wildpuppet.models import check_model_out, load_model, save_model, was_made_from

    from .session import check_cuda
    from .train_recipes import material_of, trained

    settings = settings_from(msgspec.to_builtins(arguments.settings))
    machine = Machine(device=arguments.device)
    check_cuda(machine)
    check_model_out(arguments.out)
    hold_out = frames_of(arguments.hold_out)
    material = material_of(arguments, settings, hold_out, reporter)
    identity = material.identity(arguments.recipe, settings)
    if was_made_from(arguments.out, identity):
        return load_model(arguments.out, material.puppet)
    telling = Telling(reporter)
    reporter.begin("train")
    model = trained(material, arguments.recipe, settings, machine, arguments.out, telling)
    save_model(arguments.out, model, identity)
    reporter.end("train", is_kept=False)
    return model


class Telling:
    """Passes progress on to the reporter, and at times the losses and the time left."""

    def __init__(self, reporter: Reporter) -> None:
        self.reporter, self.started, self.first = reporter, time.monotonic(), -1

    def __call__(self, done: int, total: int, losses: Mapping[str, float]) -> None:
        """Tell of a step that is done."""
        if self.first < 0:
            self.first, self.started = done - 1, time.monotonic()
        self.reporter.update(done / total)
        if done * NOTES // total > (done - 1) * NOTES // total:
            took = (time.monotonic() - self.started) / max(done - self.first, 1)
            note(self.reporter, f"train {done}/{total}: {in_short(losses)}; {_time((total - done) * took)} left")


def in_short(losses: Mapping[str, float]) -> str:
    """Write losses on a line."""
    return ", ".join(f"{name} {value:.3g}" for name, value in losses.items())


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def frames_of(text: str) -> list[int]:
    """Read "3,5,8-12"; raises SettingsError for anything else."""
    frames: list[int] = []
    for word in text.replace(" ", "").split(","):
        found = re.fullmatch(r"(\d+)(?:-(\d+))?", word)
        if found is None and word:
            raise SettingsError(f"--hold-out {text}: expected frame numbers such as 3,5,8-12, found {word!r}")
        if found is not None:
            frames += range(int(found[1]), int(found[2] or found[1]) + 1)
    return sorted(set(frames))


def train(
    source: str | Path,
    out: str | Path,
    *,
    puppet: str | Path | None = None,
    recipe: Literal["ours", "paper"] = "ours",
    hold_out: Sequence[int] = (),
    config: str = "",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    store: str | Path = STORE,
    device: Device = "auto",
    reporter: Reporter | None = None,
) -> "Model":
    """Do what `wildpuppet train` does and give the model; ``settings`` as for ``wildpuppet.run``."""
    if recipe not in ("ours", "paper"):
        raise SettingsError(f"recipe {recipe}: expected ours or paper")
    arguments = Arguments(
        source=Path(source),
        out=Path(out),
        puppet=None if puppet is None else Path(puppet),
        recipe=recipe,
        hold_out=",".join(str(frame) for frame in hold_out),
        config=config,
        store=Path(store),
        device=device,
        settings=merged(recipe_settings(recipe, config), settings or {}),
    )
    return make(arguments, reporter or Silent())
