"""`wildpuppet refine` on a drawn clip: frames with alpha, a refiner that is kept, mistakes in one line."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, Drawn, drawn_in, final_files, made_now, scene
from tests.pipelines.test_mistakes import assert_one_clear_line
from wildpuppet.api import open_run
from wildpuppet.refiners import load_refiner
from wildpuppet.settings import RefineSettings

TINY = ("--iterations=6", "--batch=2", "--patch=32", "--width=4", "--depth=2", "--critic-steps=1")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """A clip with a finished run on it."""
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    return drawn


def refine(drawn: Drawn, out: Path, *more: str) -> int:
    return run_command(["refine", str(drawn.folder / "out"), "--out", str(out), *more])


def frame(out: Path, number: int) -> np.ndarray:
    with Image.open(out / "frames" / f"frame.{number:05d}.png") as picture:
        return np.asarray(picture)


def test_every_frame_is_drawn_with_alpha_and_the_refiner_is_kept(
    drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "refined"
    assert refine(drawn, out, "--hold-out", "2", *TINY) == 0
    captured = capsys.readouterr()
    assert captured.out.splitlines()[0] == str(out / "frames")
    assert "held out" in captured.out
    assert "refined" in captured.out
    assert json.loads((out / "frames" / "manifest.json").read_text())["format"] == "refine"
    run = open_run(drawn.folder / "out")
    for t in range(FRAMES):
        picture, placed = frame(out, t), run.animation.vertices(t)
        rows, columns = np.nonzero(picture[..., 3] > 128)
        assert picture.shape == (120, 160, 4)
        assert len(rows) > 100
        low, high = placed.min(0) - 12, placed.max(0) + 12
        assert low[0] <= columns.min()
        assert columns.max() <= high[0]
        assert low[1] <= rows.min()
        assert rows.max() <= high[1]
    before = final_files(out)
    assert refine(drawn, out, "--hold-out", "2", *TINY) == 0
    assert "refiner" not in made_now(capsys.readouterr().err)
    assert final_files(out) == before
    assert load_refiner(out / "refiner", run.puppet).hold_out == (2,)
    assert refine(drawn, tmp_path / "again", "--refiner", str(out / "refiner")) == 0
    assert (frame(tmp_path / "again", 4) == frame(out, 4)).all()


def test_frames_lie_over_white_or_over_the_plate(drawn: Drawn, tmp_path: Path) -> None:
    refiner = open_run(drawn.folder / "out").refine(settings=RefineSettings(method="texture"))
    run = open_run(drawn.folder / "out")
    run.refine(tmp_path / "white", "white", refiner=refiner)
    run.refine(tmp_path / "plate", "plate", refiner=refiner)
    run.refine(tmp_path / "none", refiner=refiner)
    alpha = frame(tmp_path / "none", 3)[..., 3]
    white, plate = frame(tmp_path / "white", 3), frame(tmp_path / "plate", 3)
    assert (white[..., 3] == 255).all()
    assert (plate[..., 3] == 255).all()
    assert (white[alpha == 0][:, :3] == 255).all()
    far = np.zeros_like(alpha, bool)
    far[:6] = True
    assert not alpha[far].any()
    assert np.abs(plate[far][:, :3].astype(int) - scene().frames[3][far]).mean() < 8.0


def test_mistakes_are_told_in_one_line(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert_one_clear_line(refine(drawn, out, "--hold-out", "77", *TINY), capsys, "77", "0 to 7")
    assert_one_clear_line(refine(drawn, out, "--hold-out", "x", *TINY), capsys, "--hold-out x")
    assert_one_clear_line(refine(drawn, out, "--patch=40"), capsys, "multiple of 16", "40")
    assert_one_clear_line(refine(drawn, out, "--iterations=0"), capsys, "iterations")
    assert_one_clear_line(refine(drawn, out, "--refiner", str(tmp_path)), capsys, "refiner.json")
    assert not out.exists() or not any(out.iterdir())
    others = tmp_path / "others"
    others.mkdir()
    (others / "letter.txt").write_text("mine")
    assert_one_clear_line(refine(drawn, others, *TINY), capsys, "letter.txt")
    assert_one_clear_line(
        run_command(["refine", str(tmp_path), "--out", str(out)]), capsys, "expected the OUT folder of a run"
    )


def test_another_puppet_and_edited_frames_are_refused(
    drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "refined"
    assert refine(drawn, out, "--method", "texture") == 0
    assert drawn.run("--puppet.subdivide=1", out="fine") == 0
    capsys.readouterr()
    code = run_command(
        ["refine", str(drawn.folder / "fine"), "--out", str(tmp_path / "other"), "--refiner", str(out / "refiner")]
    )
    assert_one_clear_line(code, capsys, "another puppet")
    shutil.copyfile(out / "frames" / "frame.00001.png", out / "frames" / "frame.00002.png")
    assert_one_clear_line(refine(drawn, out, "--method", "texture"), capsys, "frame.00002.png", "changed")
