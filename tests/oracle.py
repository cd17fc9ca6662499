"""What holds the frames that are wrong: the search, the hinges, the puppet or the picture.

    python -m tests.oracle WORK STORE BENCH [OUT]     after `wildpuppet evaluate BENCH --work WORK --store STORE`

In every frame in which more than a tenth of the points is wrong at .05, the true pose (a similarity for each rigid
piece through the true points) is rounded to the search's grid and judged as the search judges, beside the pose that
was found. The frame is held by

- the puppet, where rigid pieces through the true points leave more than a tenth of them wrong,
- the search, where the true pose costs less than the one found,
- the hinges, where it costs less but for its open hinges and turns,
- the picture, where even its pixels cost more.

Sets drawn by hand have a point or two per part, too few to tell its true pose; they are left out.

OUT gets a sheet per set: the drawing, what was found and what is true, the worst frames first.
"""

import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from wildpuppet import disk
from wildpuppet.api import Run, open_run
from wildpuppet.correspond.locate import locate
from wildpuppet.correspond.pck import WRONG, Truth, read_truth
from wildpuppet.geometry import affine
from wildpuppet.motion.through_points import posed_by_points
from wildpuppet.pose.look import Look, look_at
from wildpuppet.pose.moves import Candidate, spring_cost
from wildpuppet.pose.place import place, pose_vertices, size_of
from wildpuppet.pose.search import Searcher, searcher_of
from wildpuppet.pose.similarity import similarities
from wildpuppet.render.render import mesh_of, render, texture_at
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops

KINDS = ("drawings", "clip")
HOLDERS = ("puppet", "search", "hinges", "picture")
MOST_WRONG = 0.1
"""Share of a frame's seen points that may be wrong."""
SHOWN = 6
"""Frames on a sheet."""


@dataclass(frozen=True, eq=False)
class Case:
    """A run of the benchmark, its crops with their pictures, its truth, and how wrong each point is (shares of L)."""

    run: Run
    crops: Crops
    truth: Truth
    true: np.ndarray
    error: np.ndarray
    seen: np.ndarray


@dataclass(frozen=True, eq=False)
class Verdict:
    """Who holds a frame, and what found and true pose cost: (whole, springs)."""

    frame: int
    holder: str
    wrong: float
    found: tuple[float, float]
    true: tuple[float, float]


def cases_in(work: Path, store: Path, bench: Path) -> Iterator[tuple[str, Case]]:
    """Open what `wildpuppet evaluate` left."""
    for kind in KINDS:
        for out in sorted(work.glob(f"*-{kind}")):
            truth = read_truth(
                bench / out.name.removesuffix(f"-{kind}") / ("gt.npz" if kind == "drawings" else "wild_gt.npz")
            )
            if not truth.names:
                yield out.name, case_of(open_run(out), crops_of(out, store), truth)


def crops_of(out: Path, store: Path) -> Crops:
    """Read a run's crops with their pictures, which only the store has."""
    stages = json.loads((out / "run.json").read_text())["stages"]
    (key,) = (stage["key"] for stage in stages if stage["stage"] in ("crop", "drawings"))
    (folder,) = (store / "entries").glob(f"*/*{key[2:]}*")
    return disk.load_crops(folder)


def case_of(run: Run, crops: Crops, truth: Truth) -> Case:
    """Carry the reference's points and measure; pose the puppet through the true ones."""
    reference = truth.reference
    parts = [run.puppet.names[part] for part in truth.part]
    start = truth.points[reference].astype(float)
    tracks = run.carry(start, reference, parts)
    error = np.linalg.norm(tracks.points_video - truth.points, axis=-1) / truth.length[:, None]
    base = affine.apply(crops.video_from_crop[reference], run.fit.vertices_crop[reference].astype(float))
    anchors = locate(run.puppet, base, run.fit.order[reference], start, parts)
    true = posed_by_points(run.puppet, base, anchors, truth.points.astype(float))
    return Case(run, crops, truth, true, error, truth.visible & truth.visible[reference])


def verdicts(case: Case) -> Iterator[Verdict]:
    """Judge the frames that are wrong."""
    puppet, crops = case.run.puppet, case.crops
    searcher = searcher_of(puppet, place(puppet, crops), SearchSettings())
    for frame in range(len(case.error)):
        wrong = float((case.error[frame][case.seen[frame]] > WRONG).mean()) if case.seen[frame].any() else 0.0
        is_new = frame == 0 or crops.drawing[frame] != crops.drawing[frame - 1]
        if wrong > MOST_WRONG and is_new and frame != case.truth.reference:
            yield verdict(case, searcher, frame, wrong)


def verdict(case: Case, searcher: Searcher, frame: int, wrong: float) -> Verdict:
    """Judge one frame."""
    puppet, crops, fit = case.run.puppet, case.crops, case.run.fit
    crop_from_video = affine.invert(crops.video_from_crop[frame])
    true, found = affine.apply(crop_from_video, case.true[frame]), fit.vertices_crop[frame].astype(float)
    pieces = searcher.pieces
    maps = [similarities(pieces.puppet, vertices[pieces.vertex]) for vertices in (found, true)]
    off = np.linalg.norm(pose_vertices(puppet, maps[1]) - true, axis=1) * size_of(crops.video_from_crop[frame])
    if float((off > WRONG * case.truth.length[frame]).mean()) > MOST_WRONG:
        return Verdict(frame, "puppet", wrong, (np.nan, np.nan), (np.nan, np.nan))
    size = float(np.median([size_of(one) for one in maps[1]]))
    look = look_at(searcher, crops.images[frame : frame + 1][0], searcher.size_step(size))
    rest = np.arange(puppet.num_layers)
    at_found = look.nearest(maps[0], fit.order[frame])
    at_true = [look.nearest(maps[1], order) for order in (fit.order[frame], rest)]
    costs = [cost_of(look, one) for one in (at_found, *at_true)]
    best = min(costs[1:])
    holder = (
        "search" if best[0] < costs[0][0] else "hinges" if best[0] - best[1] < costs[0][0] - costs[0][1] else "picture"
    )
    return Verdict(frame, holder, wrong, costs[0], best)


def cost_of(look: Look, candidate: Candidate) -> tuple[float, float]:
    """Give what a pose costs, and how much of that its springs do."""
    return float(look.judge([candidate])[0]), float(spring_cost(look.solution, np.array([candidate.states]))[0])


def sheet(case: Case, shown: list[Verdict]) -> np.ndarray:
    """Put the drawing, the found and the true pose side by side, a row per frame."""
    rows = []
    mesh = mesh_of(case.run.puppet)
    for one in shown:
        picture = case.crops.images[one.frame : one.frame + 1][0].astype(float)
        cells = [on_grey(picture[..., :3], picture[..., 3:] / 255)]
        crop_from_video = affine.invert(case.crops.video_from_crop[one.frame])
        scale = 1 / size_of(case.crops.video_from_crop[one.frame])
        for vertices in (
            case.run.fit.vertices_crop[one.frame],
            affine.apply(crop_from_video, case.true[one.frame]),
        ):
            drawn = render(
                torch.from_numpy(vertices[None].astype(np.float32)), mesh, texture_at(case.run.puppet, min(1.0, scale)),
                torch.from_numpy(case.run.fit.order[one.frame][None].astype(np.int64)), case.crops.size,
            ).rgba[0].numpy()  # fmt: skip
            alpha = drawn[..., 3:]
            cells.append(on_grey(255 * drawn[..., :3] / np.maximum(alpha, 1e-3), alpha))
        row = np.concatenate(cells, 1)
        text = (
            f"{one.frame}: {one.holder}, {100 * one.wrong:.0f} % wrong, found {one.found[0]:.2f} true {one.true[0]:.2f}"
        )
        cv2.putText(row, text, (6, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
        rows.append(row)
    return np.concatenate(rows)


def on_grey(colour: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Lay a picture over light grey."""
    return np.ascontiguousarray((colour * alpha + 225 * (1 - alpha)).clip(0, 255).astype(np.uint8))


def tell(line: str) -> None:
    """Write a line to stdout."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main(work: Path, store: Path, bench: Path, out: Path | None = None) -> None:
    """Print a row per set, write a sheet per set."""
    torch.set_num_threads(1)
    tell(f"| set | drawings | wrong | {' | '.join(HOLDERS)} |\n| --- | ---: | ---: |{' ---: |' * len(HOLDERS)}")
    for name, case in cases_in(work, store, bench):
        found = list(verdicts(case))
        counts = Counter(one.holder for one in found)
        number = len(np.unique(case.crops.drawing))
        tell(f"| {name} | {number} | {len(found)} | {' | '.join(str(counts[one]) for one in HOLDERS)} |")
        if out is not None and found:
            out.mkdir(parents=True, exist_ok=True)
            worst = sorted(found, key=lambda one: -one.wrong)[:SHOWN]
            cv2.imwrite(str(out / f"{name}.png"), cv2.cvtColor(sheet(case, worst), cv2.COLOR_RGB2BGR))


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:]))
