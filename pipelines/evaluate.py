"""`wildpuppet evaluate`: carry a benchmark's points through the whole pipeline and print the accuracy table.

A benchmark folder holds drawings (frames/, gt.npz) or a clip (wild.mp4, wild_gt.npz), or both, and puppet/. Each is run
like a user would run it, from its reference frame; what is kept in the store is not run again.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
import tyro

from wildpuppet.errors import InputError, SettingsError

from .arguments import value_of
from .fit_drawings import fit_drawings
from .presets import read_preset
from .reporter import Reporter, terminal
from .request import Request
from .session import Options, run_pipeline
from .track_video import track_video

if TYPE_CHECKING:
    from wildpuppet.api import Run
    from wildpuppet.correspond.compare import Carried, Kind, Row
    from wildpuppet.correspond.pck import Truth


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Carry a benchmark's points through the whole pipeline and print the accuracy beside two simple methods'."""

    bench_dirs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="BENCH_DIR")]
    """Benchmark folders, or folders of such."""
    only: Literal["drawings", "clips"] | None = None
    """Run the drawings or the clips alone."""
    work: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/evaluate")
    """Folder for the runs and results.json."""


@dataclass(frozen=True)
class Case:
    """One thing to run: a set's drawings or its clip."""

    folder: Path
    kind: "Kind"

    @property
    def truth(self) -> Path:
        """The ground truth's file."""
        return self.folder / ("gt.npz" if self.kind == "drawings" else "wild_gt.npz")

    @property
    def name(self) -> str:
        """What the table calls it."""
        return self.folder.resolve().name


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the preset's settings as defaults, so that explicit flags win."""
    return Arguments(bench_dirs=tyro.MISSING, settings=read_preset(value_of(argv, "--config")))


def main(arguments: Arguments) -> None:
    """Run every case, then print and write the table."""
    from wildpuppet.correspond.compare import means

    if not arguments.bench_dirs:
        raise SettingsError("BENCH_DIR is needed; see wildpuppet evaluate --help")
    cases = [case for folder in arguments.bench_dirs for case in cases_in(folder, arguments.only)]
    rows: list[Row] = []
    seconds = {}
    for case in cases:
        sys.stderr.write(f"{case.name} ({case.kind})\n")
        started = time.monotonic()
        with terminal() as reporter:
            rows += evaluate(case, arguments, reporter)
        seconds[f"{case.name}/{case.kind}"] = round(time.monotonic() - started, 1)
        write_results(arguments, rows + means(rows), seconds)
    print_table(rows + means(rows))
    sys.stdout.write(f"\nresults: {arguments.work / 'results.json'}\n")


def cases_in(folder: Path, only: Literal["drawings", "clips"] | None) -> list[Case]:
    """Find what a folder, or the folders in it, has to run; raises InputError where there is nothing."""
    places = [folder] if _kinds(folder) else sorted(place for place in _children(folder) if _kinds(place))
    cases = [Case(place, kind) for place in places for kind in _kinds(place) if only in (None, _plural(kind))]
    if not cases:
        raise InputError(
            f"{folder}: expected a benchmark folder (frames/ and gt.npz, or wild.mp4 and wild_gt.npz, with puppet/), "
            f"found no {only or 'drawings or clips'}; give another folder"
        )
    return cases


def _kinds(folder: Path) -> list["Kind"]:
    kinds: list[Kind] = []
    if (folder / "puppet").is_dir():
        if (folder / "gt.npz").is_file() and (folder / "frames").is_dir():
            kinds.append("drawings")
        if (folder / "wild_gt.npz").is_file() and (folder / "wild.mp4").is_file():
            kinds.append("clip")
    return kinds


def _children(folder: Path) -> Iterator[Path]:
    return folder.iterdir() if folder.is_dir() else iter(())


def _plural(kind: "Kind") -> str:
    return "clips" if kind == "clip" else kind


def evaluate(case: Case, arguments: Arguments, reporter: Reporter) -> "list[Row]":
    """Run one case and score it beside the baselines."""
    from wildpuppet.correspond.compare import compare
    from wildpuppet.correspond.pck import read_truth

    truth = read_truth(case.truth)
    ours = {"ours": carried(case, truth, arguments, reporter)}
    return compare(case.name, case.kind, truth, {**baselines(case, truth, arguments), **ours})


def carried(case: Case, truth: "Truth", arguments: Arguments, reporter: Reporter) -> "Carried":
    """Run one case and carry the reference frame's points through it."""
    from wildpuppet.correspond.compare import Carried

    run = run_case(case, truth, arguments, reporter)
    points = truth.points[truth.reference].astype(float)
    tracks = run.carry(points, truth.reference, [run.puppet.names[part] for part in truth.part])
    if tracks.points_video.shape != truth.points.shape:
        found = f"{len(tracks.frames)} frames in {case.folder}, {len(truth.points)} in {case.truth.name}"
        raise InputError(f"{case.truth}: expected ground truth for every frame, found {found}")
    return Carried(tracks.points_video, tracks.visible, tracks.confidence)


def out_of(case: Case, arguments: Arguments) -> Path:
    """Give the OUT folder of a case's run."""
    return arguments.work / f"{case.name}-{case.kind}"


def run_case(case: Case, truth: "Truth", arguments: Arguments, reporter: Reporter) -> "Run":
    """Run the pipeline on a case and open what it leaves."""
    from wildpuppet.api import open_run

    out, settings = out_of(case, arguments), arguments.checked_settings()
    puppet = case.folder / "puppet"
    if case.kind == "drawings":
        test = () if truth.test is None else tuple(int(frame) for frame in truth.test)
        request = Request(case.folder / "frames", out, settings, puppet, test_frames=test)
        run_pipeline(fit_drawings, request, arguments, reporter)
    else:
        assert truth.boxes is not None, "a clip's truth has boxes"
        x, y, width, height = (float(side) for side in truth.boxes[truth.reference])
        request = Request(case.folder / "wild.mp4", out, settings, puppet, (x, y, width, height), truth.reference)
        run_pipeline(track_video, request, arguments, reporter)
    return open_run(out)


def baselines(case: Case, truth: "Truth", arguments: Arguments) -> "dict[str, Carried]":
    """Carry the points without a puppet: leave them, and follow dense optical flow."""
    from wildpuppet.correspond.baselines import copy, flow_of_clip, flow_of_drawings
    from wildpuppet.correspond.compare import Carried
    from wildpuppet.machine import Machine
    from wildpuppet.video.decode import over_white
    from wildpuppet.video.drawings import read_drawings
    from wildpuppet.video.probe import probe
    from wildpuppet.video.read import FrameReader

    points = truth.points[truth.reference].astype(float)
    if case.kind == "drawings":
        images = read_drawings(case.folder / "frames")[1]
        drawings = [over_white(images[index : index + 1][0]) for index in range(len(images))]
        flow = flow_of_drawings(drawings, truth.reference, points)
    else:
        clip = probe(case.folder / "wild.mp4", arguments.settings.probe, Machine())
        with FrameReader(clip) as reader:
            flow = flow_of_clip((picture for _, picture in reader.frames()), truth.reference, points)
    return {"copy": Carried(copy(points, len(truth.points))), "DIS flow": Carried(flow)}


def write_results(arguments: Arguments, rows: "list[Row]", seconds: dict[str, float]) -> None:
    """Write results.json in the work folder, whole or not at all."""
    from wildpuppet import atomic

    tree = {
        "schema": "wildpuppet.evaluation/1",
        "settings": msgspec.to_builtins(arguments.settings),
        "seconds": seconds,
        "rows": [_plain(row) for row in rows],
    }
    atomic.write_text(
        arguments.work / "results.json", msgspec.json.format(msgspec.json.encode(tree), indent=1).decode()
    )


def _plain(row: "Row") -> dict[str, Any]:
    tree = asdict(row)
    for shares in ("pck", "hidden"):
        if tree["score"][shares] is not None:
            tree["score"][shares] = {str(alpha): value for alpha, value in tree["score"][shares].items()}
    return tree


def print_table(rows: "list[Row]") -> None:
    """Print the rows, the means last; plain columns where stdout is not a terminal."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    is_terminal = sys.stdout.isatty()
    table = Table(box=box.SIMPLE_HEAD if is_terminal else None)
    heads = ("set", "frames", "method", "PCK .1", ".05", ".025", ".0125", "hidden .1", ".05", "visible", "swaps", "px")
    for index, head in enumerate((*heads, "AUROC")):
        table.add_column(head, justify="left" if index < 3 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*_cells(row), style="bold" if row.num_sets and row.method == "ours" else None)
    Console(width=None if is_terminal else 140).print(table)


def _cells(row: "Row") -> list[str]:
    found = row.score
    hidden: list[float | None] = [*found.hidden.values()] if found.hidden else [None, None]
    shares = [*found.pck.values(), *hidden, found.visible_accuracy, found.swaps, found.median_pixels]
    name = row.name if row.group != "clips" or row.num_sets else f"{row.name} clip"
    cells = [name, row.frames, row.method, *("" if share is None else f"{share:.1f}" for share in shares)]
    return [*cells, "" if found.auroc is None else f"{found.auroc:.2f}"]
