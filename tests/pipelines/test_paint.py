import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import wildpuppet
from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, REFERENCE, Drawn, drawn_in, write_drawings
from tests.pipelines.test_mistakes import assert_one_clear_line
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.video.probe import probe
from wildpuppet.video.read import FrameReader


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """A clip with a finished run on it, and a template with the head painted over."""
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    assert run_command(["paint", str(drawn.folder / "out"), "--template", str(drawn.folder / "paint")]) == 0
    paint_over(drawn.folder / "paint" / "parts" / "head.png")
    return drawn


def paint_over(path: Path) -> None:
    picture = np.array(Image.open(path))
    picture[picture[..., 3] > 0, :3] = (250, 0, 250)
    Image.fromarray(picture).save(path)


def painted(run: Path, texture: Path, out: Path, *more: str) -> int:
    return run_command(["paint", str(run), "--texture", str(texture), "--out", str(out), *more])


def pinkness(picture: np.ndarray) -> np.ndarray:
    return np.minimum(picture[..., 0], picture[..., 2]).astype(int) - picture[..., 1]


def test_a_run_is_painted_over_its_own_frames(drawn: Drawn, tmp_path: Path) -> None:
    out = tmp_path / "painted"
    assert painted(drawn.folder / "out", drawn.folder / "paint", out) == 0
    said = json.loads((out / "manifest.json").read_text())
    assert said["painted_parts"] == ["head"]
    with np.load(drawn.folder / "out" / "meshes.npz") as meshes:
        head = meshes["vertices_video"][:, meshes["layer_of_vertex"] == meshes["names"].tolist().index("head")]
    reader = FrameReader(probe(drawn.video, ProbeSettings(), Machine()))
    for t in range(FRAMES):
        picture = np.asarray(Image.open(out / "frames" / f"frame.{t:05d}.png"))
        source = reader.frame(t)
        (left, top), (right, bottom) = head[t].min(0).astype(int) - 6, head[t].max(0).astype(int) + 6
        outside = np.ones(source.shape[:2], bool)
        outside[max(top, 0) : bottom, max(left, 0) : right] = False
        assert (picture[outside][:, :3] == source[outside]).all()
    reference = np.asarray(Image.open(out / "frames" / f"frame.{REFERENCE:05d}.png"))
    assert (pinkness(reference) > 150).sum() > 40


def test_drawings_are_painted_too_and_over_nothing(drawn: Drawn, tmp_path: Path) -> None:
    folder = write_drawings(tmp_path / "drawings")
    words = ["fit", str(folder), "--puppet", str(drawn.puppet), "--out", str(tmp_path / "run")]
    quick = ["--search.enabled=False", "--puppet.edge=0.25", "--fit.steps=2", "--out.preview=False"]
    assert run_command([*words, "--store", str(tmp_path / "store"), *quick]) == 0
    copy = tmp_path / "copy"  # of the puppet that the run was given, not of a template
    shutil.copytree(drawn.puppet, copy)
    paint_over(copy / "parts" / "head.png")
    for over in ("original", "plate", "none"):
        assert painted(tmp_path / "run", copy, tmp_path / over, "--over", over) == 0
        picture = np.asarray(Image.open(tmp_path / over / "frames" / "frame.00000.png"))
        assert (picture[..., 3].min() == 0) == (over == "none")
        if over != "original":  # the quick fit may be off, and then the drawing stays
            assert (pinkness(picture[..., :3]) > 150).sum() > 40


def test_from_python(drawn: Drawn, tmp_path: Path) -> None:
    run = wildpuppet.open_run(drawn.folder / "out")
    assert run.paint_template(tmp_path / "paint.psd").is_file()
    moved = tmp_path / "moved.mp4"
    shutil.copy(drawn.video, moved)
    out = run.paint(drawn.folder / "paint", tmp_path / "painted", "plate", source=moved)
    assert len(list((out / "frames").iterdir())) == FRAMES


def test_mistakes_are_told_in_one_line(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, out, paint = drawn.folder / "out", tmp_path / "painted", drawn.folder / "paint"
    assert_one_clear_line(run_command(["paint", str(run)]), capsys, "--texture and --out are needed", "--template")
    assert_one_clear_line(painted(run, paint, run), capsys, "holds other files", "give a new or an empty folder")
    assert_one_clear_line(painted(run, run / "atlas.png", out), capsys, "nothing differs", "paint on it first")
    assert_one_clear_line(painted(run, drawn.video, out), capsys, "not a picture we read")
    Image.new("RGBA", (7, 9)).save(tmp_path / "small.png")
    assert_one_clear_line(painted(run, tmp_path / "small.png", out), capsys, "is 7 x 9", "expected")
    code = run_command(["paint", str(run), "--template", str(paint)])
    assert_one_clear_line(code, capsys, "already exists", "choose another name")
    other = tmp_path / "other.mp4"
    other.write_bytes(b"no video")
    assert_one_clear_line(painted(run, paint, out, "--source", str(other)), capsys, "expected the clip of the run")
    assert not out.exists()
