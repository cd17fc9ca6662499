"""`wildpuppet reproduce`: the paper's tables and figures on a benchmark, for the paper's method, ours and baselines.

Table 1 is how far pictures are from the drawings kept for testing, Table 2 how well points are carried between any two
of them. Everything trained or answered is kept in OUT; a command that was stopped goes on where it was.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import tyro

from wildpuppet.errors import InputError, SettingsError
from wildpuppet.settings import RefineSettings
from wildpuppet.store import digest_of_folder

from . import evaluate, paper_motion, paper_tables
from .arguments import value_of
from .evaluate import Case, cases_in
from .paper_tables import Method
from .paper_work import QUICK, Effort, SetWork
from .presets import read_preset
from .refine import checked
from .reporter import terminal
from .session import Options

if TYPE_CHECKING:
    from wildpuppet.tables.answer import Answer
    from wildpuppet.tables.table import Score

SCHEMA = "wildpuppet.tables/1"
OURS = "ours"
"""The method whose runs the applications are measured on."""
SHOWN = 6
"""Drawings in a figure."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Print the paper's tables on a benchmark's drawings, and draw its figures."""

    bench_dirs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="BENCH_DIR")]
    """Benchmark folders, or folders of such."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME")] = ()
    """Names of sets; all of them when left out."""
    methods: Annotated[tuple[str, ...], tyro.conf.arg(metavar="METHOD")] = ()
    """Names of methods, as the tables have them; all of them when left out."""
    seeds: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    """How often what depends on chance is trained; from 2 on the tables show the standard deviation."""
    paper_iterations: Annotated[int, tyro.conf.arg(metavar="N")] = 0
    """Training steps of the paper's network; 0 is the preset's, which takes long. The tables say what it was."""
    autoencoder_steps: Annotated[int, tyro.conf.arg(metavar="N")] = 400
    """Training steps of the deforming auto-encoder."""
    refine: RefineSettings = field(default_factory=RefineSettings)
    """The refinement. The paper's takes the same but for ``method`` and ``squared``."""
    quick: tyro.conf.UseCounterAction[int] = 0
    """Train for a moment only: to see that everything works, not for numbers."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/reproduce")
    """Folder for the tables (tables.md, tables.json), the figures and everything that is trained."""


@dataclass
class Found:
    """What is known so far: scores, what was left out and why."""

    scores: "list[Score]" = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the preset's settings as defaults, so that explicit flags win."""
    return Arguments(bench_dirs=tyro.MISSING, settings=read_preset(value_of(argv, "--config")))


def main(arguments: Arguments) -> None:
    """Answer set by set; tables are written after each."""
    methods = _chosen(arguments)
    found = Found()
    cases = _cases(arguments)
    for number, case in enumerate(cases, 1):
        sys.stderr.write(f"{number} of {len(cases)}: {case.name}\n")
        _reproduce(case, methods, arguments, found)
        text = _written(arguments, found)
    sys.stdout.write(f"{text}\ntables: {arguments.out / 'tables.md'}\n")


def _chosen(arguments: Arguments) -> list[Method]:
    if not arguments.bench_dirs:
        raise SettingsError("BENCH_DIR is needed; see wildpuppet reproduce --help")
    if arguments.until is not None:
        raise SettingsError("--until: the tables need whole runs; leave it out")
    if arguments.seeds < 1:
        raise SettingsError(f"--seeds {arguments.seeds}: expected 1 or more")
    known = {method.name: method for method in paper_tables.METHODS}
    for name in arguments.methods:
        if name not in known:
            raise SettingsError(f"--methods {name}: expected some of {'; '.join(known)}")
    return [method for name, method in known.items() if name in (arguments.methods or known)]


def _cases(arguments: Arguments) -> list[Case]:
    cases = [case for folder in arguments.bench_dirs for case in cases_in(folder, "drawings")]
    names = [case.name for case in cases]
    for name in arguments.only:
        if name not in names:
            raise SettingsError(f"--only {name}: expected some of {', '.join(names)}")
    return [case for case in cases if case.name in (arguments.only or names)]


def _reproduce(case: Case, methods: list[Method], arguments: Arguments, found: Found) -> None:
    """Add one set's scores, and draw its figure."""
    with terminal() as reporter:
        work = SetWork(
            case=case,
            content=digest_of_folder(case.folder)[0],
            out=arguments.out,
            options=_options(arguments),
            effort=effort_of(arguments),
            reporter=reporter,
        )
        if work.truth.test is None or len(work.truth.test) < 2:
            raise InputError(f"{case.truth}: expected at least two drawings kept for testing (test)")
        shown: dict[str, Answer] = {}
        for method in methods:
            for seed in range(arguments.seeds if method.is_random else 1):
                answer = paper_tables.answered(work, method, seed)
                if isinstance(answer, str):
                    found.missing.append(f"{method.name} on {case.name}, seed {seed}: {answer}")
                    continue
                found.scores += _scores(work, method.name, seed, answer)
                shown.setdefault(method.name, answer)
        if any(method.name == OURS for method in methods):
            for name in paper_motion.APPLICATIONS:
                scores = paper_motion.scores_of(work, name)
                if isinstance(scores, str):
                    found.missing.append(f"{name} on {case.name}: {scores}")
                else:
                    found.scores += scores
    _draw(work, shown)


def _options(arguments: Arguments) -> evaluate.Arguments:
    shared = {name: getattr(arguments, name) for name in ("config", "store", "redo", "device")}
    return evaluate.Arguments(bench_dirs=(), settings=arguments.checked_settings(), **shared)


def _scores(work: SetWork, method: str, seed: int, answer: "Answer") -> "list[Score]":
    from wildpuppet.tables.error import picture_errors
    from wildpuppet.tables.pairs import score_pairs
    from wildpuppet.tables.table import Score

    values: dict[str, float] = {}
    if answer.pictures is not None:
        error = picture_errors(work.tested, answer.pictures)
        values |= {"mse": error.whole, "mse box": error.box}
    if answer.carried is not None:
        shares, _ = score_pairs(work.truth, work.test, answer.carried)
        values |= {f"pck {alpha:g}": share for alpha, share in shares.items()}
    return [Score(work.case.name, method, seed, measure, value) for measure, value in values.items()]


def _draw(work: SetWork, shown: "dict[str, Answer]") -> None:
    from wildpuppet.export.sheet import spread
    from wildpuppet.tables.sheet import grid, save_sheet

    columns = {name: answer.pictures for name, answer in shown.items() if answer.pictures is not None}
    if not columns:
        return
    rows = spread(len(work.test), SHOWN)
    columns = {"drawing": tuple(work.tested), **columns}
    sheet = grid({name: [pictures[row] for row in rows] for name, pictures in columns.items()})
    save_sheet(work.out / "figures" / f"{work.case.name}.png", sheet)


def _written(arguments: Arguments, found: Found) -> str:
    """Write tables.md and tables.json; give the former's text."""
    from wildpuppet import atomic
    from wildpuppet.tables.paper import paper_text

    effort = effort_of(arguments)
    text = paper_text(found.scores, found.missing, notes_of(arguments, effort))
    tree: dict[str, Any] = {
        "schema": SCHEMA,
        "settings": msgspec.to_builtins(arguments.settings),
        "seeds": arguments.seeds,
        "effort": asdict(effort),
        "scores": [asdict(score) for score in found.scores],
        "missing": found.missing,
    }
    atomic.write_text(arguments.out / "tables.md", text)
    atomic.write_text(arguments.out / "tables.json", msgspec.json.format(msgspec.json.encode(tree), indent=1).decode())
    return text


def effort_of(arguments: Arguments) -> Effort:
    """Say how long things are trained."""
    if arguments.quick:
        return QUICK
    paper = {"iterations": arguments.paper_iterations} if arguments.paper_iterations else {}
    return Effort(autoencoder_steps=arguments.autoencoder_steps, refine=checked(arguments.refine), paper=paper)


def notes_of(arguments: Arguments, effort: Effort) -> list[str]:
    """Say how long things were trained and how often."""
    times = f"{arguments.seeds} seeds, ± their standard deviation" if arguments.seeds > 1 else "one seed"
    steps = {
        "the paper's network": effort.paper_iterations,
        f"refinements (each with {effort.refine.critic_steps} of the critic)": effort.refine.iterations,
        "the auto-encoder": effort.autoencoder_steps,
    }
    return [f"Trained things: {times}; {', '.join(f'{what} {number} steps' for what, number in steps.items())}."]
