"""`wildpuppet ablate`: evaluate a benchmark with one thing switched off at a time, and say what each is worth.

Every ablation uses the same store, so a stage that an ablation does not touch is not run again. What is measured stays
in the work folder, one file per ablation: a command that was stopped goes on where it was, and one that is given other
steps adds to the table. A result counts as long as the settings, the stages' versions and the benchmark's files stay.
"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tyro

from wildpuppet.errors import SettingsError
from wildpuppet.runs import TIMINGS
from wildpuppet.stages import STAGES
from wildpuppet.store import digest_of, digest_of_folder, read_json

from . import evaluate
from .ablations import ABLATIONS, DEFAULT, chosen, settings_of
from .arguments import value_of
from .evaluate import Case, cases_in
from .presets import read_preset
from .reporter import terminal

SCHEMA = "wildpuppet.ablation/1"
TABLE = "ablations.md"
ALPHAS = (0.1, 0.05, 0.025)
COMPARED = 0.05
GROUPS = ("hand", "rigs", "clips")
"""Kinds of sets. Of rigs, which have frames that are kept for testing, these count; of the others all frames."""


@dataclass(frozen=True, kw_only=True)
class Arguments(evaluate.Arguments):
    """Evaluate a benchmark with one thing switched off at a time and print what each is worth, as a markdown table."""

    work: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/ablate")
    """Folder for the runs, what was measured, and the table (ablations.md)."""
    steps: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME")] = ()
    """What to switch off, by name; all but the slow ones when left out. The settings at hand are always measured."""


@dataclass(frozen=True)
class Result:
    """One ablation: percentages of right points by group and alpha, and the seconds that all its stages take."""

    name: str
    pck: dict[str, dict[float, float | None]]
    swaps: dict[str, float | None]
    seconds: float


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the preset's settings as defaults, so that explicit flags win."""
    return Arguments(bench_dirs=tyro.MISSING, settings=read_preset(value_of(argv, "--config")))


def main(arguments: Arguments) -> None:
    """Measure ablation by ablation; the table is written after each."""
    from wildpuppet import atomic

    if not arguments.bench_dirs:
        raise SettingsError(f"BENCH_DIR is needed; steps are {', '.join(ABLATIONS)}; see wildpuppet ablate --help")
    if arguments.until is not None:
        raise SettingsError("--until: an ablation runs to its end; leave it out")
    names = chosen(arguments.steps)
    cases = [case for folder in arguments.bench_dirs for case in cases_in(folder, arguments.only)]
    contents = [digest_of_folder(case.folder)[0] for case in cases]
    results: list[Result] = []
    for number, name in enumerate(names, 1):
        sys.stderr.write(f"{number} of {len(names)}: {name}, {ABLATIONS[name].what}\n")
        own = replace(arguments, settings=settings_of(name, arguments.settings), work=arguments.work / name)
        results.append(measured(name, cases, contents, own))
        atomic.write_text(arguments.work / TABLE, table(results))
    sys.stdout.write(f"{table(results)}\ntable: {arguments.work / TABLE}\n")


def measured(name: str, cases: Sequence[Case], contents: Sequence[str], arguments: Arguments) -> Result:
    """Measure every case, or take what is kept."""
    path = arguments.work / "results.json"
    kept = _kept(path)
    found: dict[str, Any] = {}
    for number, (case, content) in enumerate(zip(cases, contents, strict=True), 1):
        label = f"{case.name}/{case.kind}"
        sys.stderr.write(f"  {number} of {len(cases)}: {label}\n")
        identity = identity_of(content, arguments)
        before = kept.get(label)
        if before is not None and before["identity"] == identity and arguments.redo is None:
            found[label] = before
        else:
            found[label] = {"identity": identity, **_measure(case, arguments)}
            _write(path, {**kept, **found})
    return result_of(name, list(found.values()))


def identity_of(content: str, arguments: Arguments) -> str:
    """Give what a result depends on: the benchmark's files, the settings and the stages' versions."""
    versions = {stage.name: stage.version for stage in STAGES}
    return digest_of([content, msgspec.to_builtins(arguments.settings), versions])


def _measure(case: Case, arguments: Arguments) -> dict[str, Any]:
    from wildpuppet.correspond.compare import compare
    from wildpuppet.correspond.pck import read_truth

    truth = read_truth(case.truth)
    with terminal() as reporter:
        ours = evaluate.carried(case, truth, arguments, reporter)
    timings = read_json(evaluate.out_of(case, arguments) / TIMINGS)
    rows = compare(case.name, case.kind, truth, {"ours": ours})
    row = rows[-1 if rows[0].group == "rigs" else 0]  # all frames, then those kept for testing if there are any
    pck = {str(alpha): row.score.pck[alpha] for alpha in ALPHAS}
    seconds = sum(timings["seconds"].values())
    return {"group": row.group, "frames": row.frames, "pck": pck, "swaps": row.score.swaps, "seconds": seconds}


def _kept(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    tree = read_json(path)
    return dict(tree["cases"]) if tree.get("schema") == SCHEMA else {}


def _write(path: Path, cases: dict[str, Any]) -> None:
    from wildpuppet import atomic

    tree = {"schema": SCHEMA, "cases": cases}
    atomic.write_text(path, msgspec.json.format(msgspec.json.encode(tree), indent=1).decode())


def result_of(name: str, cases: Sequence[dict[str, Any]]) -> Result:
    """Average over the sets of each group, each set weighing the same."""
    of = {group: [case for case in cases if case["group"] == group] for group in GROUPS}
    of = {group: same for group, same in of.items() if same}
    return Result(
        name,
        {g: {alpha: _mean(case["pck"][str(alpha)] for case in same) for alpha in ALPHAS} for g, same in of.items()},
        {g: _mean(case["swaps"] for case in same) for g, same in of.items()},
        sum(case["seconds"] for case in cases),
    )


def _mean(values: Iterable[float | None]) -> float | None:
    """Average what there is; None where nothing could be counted."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def table(results: Sequence[Result]) -> str:
    """Write markdown: per group the PCKs, what is lost or won at .05 against the default, swaps where they show."""
    first = results[0]
    assert first.name == DEFAULT, "differences are from the default"
    heads = ["switched off"]
    for group, swaps in first.swaps.items():
        heads += [f"{group} .1", ".05", ".025", "+/-", *(["swaps"] if swaps is not None else [])]
    rows = [[*heads, "seconds"], ["---", *["---:"] * len(heads)], *(_cells(result, first) for result in results)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _cells(result: Result, first: Result) -> list[str]:
    cells = [f"{result.name}: {ABLATIONS[result.name].what}"]
    for group, pck in result.pck.items():
        now, before = pck[COMPARED], first.pck[group][COMPARED]
        change = "" if result is first or now is None or before is None else f"{now - before:+.1f}"
        cells += [*(_shown(pck[alpha]) for alpha in ALPHAS), change]
        cells += [] if first.swaps[group] is None else [_shown(result.swaps[group])]
    return [*cells, f"{result.seconds:.0f}"]


def _shown(share: float | None) -> str:
    return "" if share is None else f"{share:.1f}"
