"""The ablation command on a tiny drawn benchmark: one set of drawings and its clip."""

from pathlib import Path

import numpy as np
import pytest

from pipelines import evaluate
from pipelines.ablations import ABLATIONS, DEFAULT, chosen, settings_of
from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, QUICK, REFERENCE, drawn_in, scene, write_drawings
from wildpuppet.settings import Settings

FLAGS = (*QUICK, "--fit.steps=12")


def make_bench(folder: Path) -> Path:
    """A set as the benchmark has them, points on torso and head."""
    bench = folder / "bench" / "doll"
    bench.mkdir(parents=True)
    drawn = drawn_in(bench)
    drawn.video.rename(bench / "wild.mp4")
    write_drawings(bench / "frames")
    layers = [scene().layer(name) for name in ("torso", "head")]
    grids = [scene().points_of(layer, 12) for layer in layers]
    pairs = list(zip(grids, layers, strict=True))
    truth = {
        "points": np.concatenate([scene().truth(grid, layer) for grid, layer in pairs], 1),
        "visible": np.concatenate([scene().visible(grid, layer) for grid, layer in pairs], 1),
        "part": np.concatenate([np.full(len(grid), layer) for grid, layer in pairs]),
        "reference": REFERENCE,
    }
    np.savez(bench / "gt.npz", **truth, test=np.arange(FRAMES // 2), canvas=np.array([160, 120]))
    np.savez(bench / "wild_gt.npz", **truth, boxes=scene().boxes)
    return bench.parent


def rows_of(table: str) -> dict[str, list[str]]:
    cells = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in table.splitlines()]
    return {row[0].split(":")[0]: row[1:] for row in cells if row[0] != "---"}


def test_one_thing_at_a_time_on_one_store_and_never_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(tmp_path)
    words = [str(bench), "--store", str(tmp_path / "store"), "--work", str(tmp_path / "work"), *FLAGS]
    assert run_command(["ablate", *words, "--steps", "no-fit"]) == 0
    told = capsys.readouterr()
    first, _, second = told.err.partition("2 of 2: no-fit")
    assert "track: kept" not in first
    assert second.count("track: kept") == second.count("crop: kept") == 1
    table = (tmp_path / "work" / "ablations.md").read_text()
    assert told.out.startswith(table)
    rows = rows_of(table)
    assert rows["switched off"] == ["rigs .1", ".05", ".025", "+/-", "clips .1", ".05", ".025", "+/-", "seconds"]
    ours, without = rows[DEFAULT], rows["no-fit"]
    assert ours[3] == ours[7] == ""
    assert float(without[5]) < float(ours[5])  # the fit is worth something on the clip
    assert float(without[7]) == pytest.approx(float(without[5]) - float(ours[5]), abs=0.11)

    assert run_command(["evaluate", *words]) == 0
    evaluated = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert next(row[3:6] for row in evaluated if row[:4] == ["doll", "clip", "all", "ours"]) == ["ours", *ours[4:6]]
    assert next(row[3:6] for row in evaluated if row[:3] == ["doll", "test", "ours"]) == ours[:3]

    def refuse(*_: object) -> None:
        raise AssertionError("what was measured must not be measured again")

    monkeypatch.setattr(evaluate, "run_case", refuse)
    assert run_command(["ablate", *words, "--steps", "no-fit"]) == 0
    assert (tmp_path / "work" / "ablations.md").read_text() == table
    with pytest.raises(AssertionError, match="not be measured again"):
        run_command(["ablate", *words, "--fit.area=0.1", "--steps", "no-fit"])


def test_mistakes_are_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    for words, message in (
        (["--steps", "no-such"], "--steps no-such: expected some of default, no-search"),
        (["--until", "fit"], "--until: an ablation runs to its end"),
        ([], "expected a benchmark folder"),
    ):
        assert run_command(["ablate", str(tmp_path / "empty"), *words]) == 2
        err = capsys.readouterr().err
        assert message in err
        assert err.count("\n") == 1
    assert run_command(["ablate"]) == 2


def test_every_ablation_changes_something_and_slow_ones_wait_to_be_named() -> None:
    assert settings_of(DEFAULT, Settings()) == Settings()
    all_settings = [settings_of(name, Settings()) for name in ABLATIONS]
    assert len({str(settings) for settings in all_settings}) == len(ABLATIONS)
    assert "paper" not in chosen(())
    assert chosen(("paper", "no-fit")) == [DEFAULT, "paper", "no-fit"]
