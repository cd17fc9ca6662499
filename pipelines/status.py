"""`wildpuppet status`: say for each stage *kept*, or *would run because settings.fit.area 0.05 -> 0.2*.

The very pipelines that make a run are walked with a keeper that makes nothing: what is kept is followed, what is not is
compared with what the run used last time, and what depends on it is unknown.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tyro

from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.runs import RUN, check_out
from wildpuppet.settings import Settings
from wildpuppet.stages import Stage
from wildpuppet.store import Kept, Question, Store, read_json, why

from .arguments import first_path, value_of
from .fit_drawings import fit_drawings
from .keeper import Keeper, flat_digests
from .outcome import in_short
from .presets import merged, read_preset
from .request import Request, request_from
from .session import STORE, Pipeline
from .track_video import track_video

INPUTS_UNKNOWN = "its inputs would be made anew"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Say for each stage of a run whether it is kept or would run, and why. Settings given as flags are tried on it."""

    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN|VIDEO")]
    """OUT folder of a run, or a video (or a folder of drawings): then all runs on it that the store knows."""
    config: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = ""
    """Preset to try instead of the run's own settings."""
    store: Annotated[Path, tyro.conf.arg(metavar="DIR")] = STORE
    """Folder of kept results."""
    settings: Annotated[Settings, tyro.conf.arg(name="")] = field(default_factory=Settings)


@dataclass(frozen=True)
class Past:
    """A run as it was noted: what was asked, and the question of each stage."""

    request: Request
    stages: Mapping[str, Question]
    is_finished: bool


class NotKept(Exception):  # noqa: N818 not an error: the walk ends where a value is needed that nobody kept
    """A value is needed that is not in the store."""


class Planner(Keeper):
    """Walks a pipeline and makes nothing."""

    def __init__(self, store: Store, settings: Settings, past: Mapping[str, Question]) -> None:
        super().__init__(store, settings, Machine())
        self.past = past
        self.verdicts: dict[str, list[str | None]] = {}

    def keep(self, stage: Stage, *, weight: float = 1.0, **inputs: Kept[Any] | list[Kept[Any]]) -> Kept[Any]:
        """Note whether the result is kept; give it, or a result that is unknown."""
        step = stage.name.split(".")[0]
        unknown = [name for name, kept in inputs.items() if None in flat_digests({name: kept})]
        if unknown:
            return self._missing(step, f"{' and '.join(unknown)} would be made anew")
        question = self._question(stage, inputs)
        entry = self.store.look_up(question)
        if entry is None:
            return self._missing(step, why(question, self.past.get(stage.name)))
        self.verdicts.setdefault(step, []).append(None)
        return Kept(entry.digest, partial(stage.load, entry.folder), entry)

    def _missing(self, step: str, reason: str) -> Kept[Any]:
        self.verdicts.setdefault(step, []).append(reason)

        def load() -> Any:
            raise NotKept(step)

        return Kept(None, load)

    @contextmanager
    def step(self, name: str, total: float) -> Iterator[None]:
        """Report nothing."""
        yield


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the settings of the run (or of the newest run on the video) as defaults, so that flags show a change."""
    config, path = value_of(argv, "--config"), first_path(argv)
    settings = Settings()
    if config:
        settings = read_preset(config)
    elif path is not None:
        settings = past_runs(path, Path(value_of(argv, "--store") or STORE))[-1].request.settings
    return Arguments(path=tyro.MISSING, settings=settings)


def main(arguments: Arguments) -> None:
    """Print the status of one run, or of all runs on a video."""
    runs = past_runs(arguments.path, arguments.store)
    changes = {} if arguments.config else _changes(runs[-1].request.settings, arguments.settings)
    for past in runs:
        state = "" if past.is_finished else " (stopped before its end)"
        sys.stdout.write(f"{past.request.source} -> {past.request.out}{state}\n")
        asked = arguments.settings if arguments.config else merged(past.request.settings, changes)
        request = replace(past.request, settings=asked)
        for step, verdict in status_of(request, Store(arguments.store), past.stages).items():
            sys.stdout.write(f"  {step:<12}{verdict}\n")
        sys.stdout.write(advice(past))


def advice(past: Past) -> str:
    """Say how the frames of a finished run went; nothing where OUT is gone."""
    if not past.is_finished or not (past.request.out / RUN).is_file():
        return ""
    return f"  {in_short(read_json(past.request.out / RUN))}\n"


def _changes(before: Settings, after: Settings) -> dict[str, dict[str, Any]]:
    """List what flags changed: table -> setting -> value."""
    old, new = msgspec.to_builtins(before), msgspec.to_builtins(after)
    return {table: {name: value for name, value in new[table].items() if value != old[table][name]} for table in new}


def past_runs(path: Path, store: Path) -> list[Past]:
    """Find the run that OUT folder ``path`` holds, or the runs on video or folder ``path``, newest last."""
    if (path / RUN).is_file():
        tree = read_json(path / RUN)
        if "made_by" in tree.get("request", {}):
            command = tree["request"]["made_by"]["command"]
            raise InputError(f"{path}: made by `wildpuppet {command}` from another run; ask for the status of that one")
        if "request" in tree:
            return [_past(tree, path)]
    notes = Store(store).runs().values()
    wanted = str(path.absolute())
    found = [note for note in notes if wanted in (note["out"], note["request"]["source"])]
    if not found:
        check_out(path)
        raise InputError(
            f"{path}: expected a run's OUT folder or a video that was run; the store {store} knows no run of it "
            "(another --store?)"
        )
    return [_past(note, Path(note["out"])) for note in found]


def _past(tree: Mapping[str, Any], out: Path) -> Past:
    questions = [Question(item["stage"], item["version"], item["settings"], item["inputs"]) for item in tree["stages"]]
    named = {question.stage: question for question in questions}
    return Past(request_from(tree["request"], out), named, bool(tree.get("is_finished")))


def status_of(request: Request, store: Store, past: Mapping[str, Question]) -> dict[str, str]:
    """Say for each step of a run whether it is kept or would run, and why."""
    planner = Planner(store, request.settings, past)
    pipeline: Pipeline = fit_drawings if request.box_video is None else track_video
    try:
        pipeline(planner, request)
    except NotKept:
        for stage in past:
            planner.verdicts.setdefault(stage.split(".")[0], [INPUTS_UNKNOWN])
    return {step: _sentence(verdicts) for step, verdicts in planner.verdicts.items()}


def _sentence(verdicts: list[str | None]) -> str:
    reasons = [verdict for verdict in verdicts if verdict is not None]
    if not reasons:
        return "kept"
    share = f" ({len(reasons)} of {len(verdicts)} parts)" if len(verdicts) > len(reasons) else ""
    return f"would run because {reasons[0]}{share}"
