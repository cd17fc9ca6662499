"""The paper's tables on a drawn benchmark of six drawings: every method answers, and nothing is made twice."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines import evaluate, paper_tables
from pipelines.cli import run_command
from tests.pipelines.drawn import QUICK, REFERENCE, scene
from wildpuppet.puppet.folder import write_cutout

DRAWINGS = 6
TEST = [1, 4]


def make_bench(folder: Path) -> Path:
    """One set, as the benchmark has them, with points on torso and head."""
    bench = folder / "bench" / "doll"
    (bench / "frames").mkdir(parents=True)
    write_cutout(scene().cutout, bench / "puppet")
    for index in range(DRAWINGS):
        picture = np.dstack([scene().frames[index], scene().alpha[index]])
        Image.fromarray(picture).save(bench / "frames" / f"{index:02d}.png")
    layers = [scene().layer(name) for name in ("torso", "head")]
    pairs = [(scene().points_of(layer, 12), layer) for layer in layers]
    truth = {
        "points": np.concatenate([scene().truth(grid, layer) for grid, layer in pairs], 1)[:DRAWINGS],
        "visible": np.concatenate([scene().visible(grid, layer) for grid, layer in pairs], 1)[:DRAWINGS],
        "part": np.concatenate([np.full(len(grid), layer) for grid, layer in pairs]),
    }
    np.savez(bench / "gt.npz", **truth, reference=REFERENCE, test=np.array(TEST), canvas=np.array([160, 120]))
    return bench.parent


def words_of(folder: Path, *more: str) -> list[str]:
    places = ["--store", str(folder / "store"), "--out", str(folder / "out")]
    return ["reproduce", str(make_bench(folder) if not (folder / "bench").exists() else folder / "bench"), *places,
            "--quick", *QUICK, "--fit.steps=12", *more]  # fmt: skip


def test_every_method_answers_once_and_the_tables_say_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_command(words_of(tmp_path)) == 0
    text = (tmp_path / "out" / "tables.md").read_text()
    assert capsys.readouterr().out.startswith(text)
    assert "Left out" not in text
    tree = json.loads((tmp_path / "out" / "tables.json").read_text())
    value = {(score["method"], score["measure"]): score["value"] for score in tree["scores"]}
    methods = {method.name for method in paper_tables.METHODS}
    assert {method for method, _ in value} == methods
    assert value["ours", "mse"] < 0.5 * value["copy", "mse"]  # the puppet moved to where the drawings are
    assert value["ours", "pck 0.05"] > value["copy", "pck 0.05"]
    run = json.loads((tmp_path / "out" / "runs" / "paper-0" / "doll-drawings" / "run.json").read_text())
    assert run["test"] == TEST  # no training saw them
    assert (tmp_path / "out" / "figures" / "doll.png").is_file()

    def refuse(*_: object) -> None:
        raise AssertionError("what was answered must not be answered again")

    monkeypatch.setattr(evaluate, "run_case", refuse)
    assert run_command(words_of(tmp_path)) == 0
    assert (tmp_path / "out" / "tables.md").read_text() == text


def test_what_fails_is_left_out_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_bench(tmp_path)
    (tmp_path / "bench" / "doll" / "puppet" / "puppet.json").write_text("{}")
    assert run_command(words_of(tmp_path, "--methods", "copy", "ours")) == 0
    text = (tmp_path / "out" / "tables.md").read_text()
    assert "| copy |" in text
    assert "| ours |" not in text
    assert "- ours on doll, seed 0: " in text


def test_mistakes_are_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for more, message in (
        (["--only", "cat"], "--only cat: expected some of doll"),
        (["--methods", "magic"], "--methods magic: expected some of copy; flow warp"),
        (["--seeds", "0"], "--seeds 0: expected 1 or more"),
        (["--until", "fit"], "--until: the tables need whole runs"),
    ):
        assert run_command(words_of(tmp_path, *more)) == 2
        err = capsys.readouterr().err
        assert message in err
        assert err.count("\n") == 1
