import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, Drawn, drawn_in, write_drawings
from tests.pipelines.test_mistakes import assert_one_clear_line
from wildpuppet.api import open_run
from wildpuppet.export.formats import FORMATS
from wildpuppet.export.options import Options


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """A clip with a finished run on it."""
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    return drawn


def exported(run: Path, out: Path, formats: str, *more: str) -> int:
    return run_command(["export", str(run), "--to", formats, "--out", str(out), *more])


def test_a_run_is_exported_with_its_own_times(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exported(drawn.folder / "out", tmp_path / "files", "png,prores", "--first-frame", "1001") == 0
    assert capsys.readouterr().out.splitlines() == [str(tmp_path / "files" / name) for name in ("png", "prores")]
    said = json.loads((tmp_path / "files" / "png" / "manifest.json").read_text())
    with np.load(drawn.folder / "out" / "meshes.npz") as meshes:
        assert said["pts"] == meshes["pts"].tolist()
        assert said["frames"] == meshes["frames"].tolist()
        assert said["parts"] == meshes["names"].tolist()
    assert said["first_frame"] == 1001
    assert said["name"] == "out"
    last = tmp_path / "files" / "png" / "combined" / f"combined.{1000 + FRAMES:05d}.png"
    with Image.open(last) as picture:
        assert picture.size == (160, 120)
        assert np.asarray(picture)[..., 3].any()


def test_drawings_are_exported_too(drawn: Drawn, tmp_path: Path) -> None:
    folder = write_drawings(tmp_path / "drawings")
    words = ["fit", str(folder), "--puppet", str(drawn.puppet), "--out", str(tmp_path / "run")]
    quick = ["--search.enabled=False", "--puppet.edge=0.25", "--fit.steps=2", "--out.preview=False"]
    assert run_command([*words, "--store", str(tmp_path / "store"), *quick]) == 0
    assert exported(tmp_path / "run", tmp_path / "files", "png") == 0
    said = json.loads((tmp_path / "files" / "png" / "manifest.json").read_text())
    assert said["rate"] == "4"
    assert any("made up" in words for words in said["left_out"])


def test_mistakes_are_told_in_one_line(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, out = drawn.folder / "out", tmp_path / "files"
    assert_one_clear_line(exported(run, out, "pngg"), capsys, "unknown format pngg", "did you mean png")
    assert_one_clear_line(exported(run, out, "png", "--first-frame", "-1"), capsys, "--first-frame -1", "0 or more")
    assert_one_clear_line(exported(run, out, "png", "--units-per-pixel", "0"), capsys, "above 0")
    assert_one_clear_line(exported(drawn.puppet, out, "png"), capsys, "expected the OUT folder of a run")
    assert_one_clear_line(exported(run, run, "png"), capsys, "holds other files", "give a new or an empty folder")
    unfinished = tmp_path / "unfinished"
    unfinished.mkdir()
    (unfinished / "run.json").write_text('{"schema": "wildpuppet.run/1", "is_finished": false}')
    assert_one_clear_line(exported(unfinished, out, "png"), capsys, "has not finished", "run it again")
    assert not out.exists()


def test_formats_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["formats"]) == 0
    table = capsys.readouterr().out
    assert all(f"\n{each.name} " in table for each in FORMATS)


def test_from_python(drawn: Drawn, tmp_path: Path) -> None:
    folders = open_run(drawn.folder / "out").export("glb,usd", tmp_path, Options(units_per_pixel=1.0))
    assert folders == [tmp_path / "glb", tmp_path / "usd"]
    assert json.loads((folders[0] / "manifest.json").read_text())["units_per_pixel"] == 1.0
