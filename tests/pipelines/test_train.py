"""`wildpuppet train` from the command line: a model, a killed training, another puppet, mistakes in words."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipelines.cli import run_command
from pipelines.train import frames_of
from tests.figure import DOLL, draw_figure
from tests.pipelines.drawn import Drawn, drawn_in, write_drawings
from wildpuppet import load_model, open_run
from wildpuppet.errors import SettingsError
from wildpuppet.puppet.folder import write_cutout
from wildpuppet.recut import run_crops

ROOT = Path(__file__).parents[2]
TINY = ("--train.iterations=5", "--train.batch=6", "--train.encoder-pixels=24", "--train.code=16")
FILES = ("model.json", "model.safetensors", "puppet.npz")

DIES_AT = """
import os, signal, sys
from pipelines.cli import main
from wildpuppet.deform import teach
teach.CHECKPOINT_SECONDS = 0.0
steps = int(sys.argv.pop(1))
step = teach._step
def dies(network, optimizer, lesson, train, number):
    if number == steps:
        os.kill(os.getpid(), signal.SIGKILL)
    return step(network, optimizer, lesson, train, number)
teach._step = dies
main()
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    assert train(drawn, "model") == 0
    return drawn


def words(drawn: Drawn, out: str, *more: str) -> list[str]:
    return ["train", str(drawn.folder / "out"), "--out", str(drawn.folder / out), *TINY, "--hold-out", "2", *more]


def train(drawn: Drawn, out: str, *more: str) -> int:
    return run_command(words(drawn, out, *more))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_model_reads_crops_and_is_there_again_at_once(drawn: Drawn, capsys: pytest.CaptureFixture[str]) -> None:
    folder, run = drawn.folder / "model", open_run(drawn.folder / "out")
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    description = json.loads((folder / "model.json").read_text())
    assert description["recipe"] == "ours"
    assert description["hold_out"] == [2]
    assert set(description["losses"]) == {"vertices", "points", "code"}
    model, crops = load_model(folder, run.puppet), run_crops(run)
    codes = model.encode(crops.images[:2])
    assert codes.shape == (2, 16)
    assert model.decode(codes).shape == (2, len(run.puppet.vertices), 2)
    before = contents(folder)
    assert train(drawn, "model") == 0
    assert "kept" not in capsys.readouterr().err
    assert contents(folder) == before


def test_killed_and_started_again_gives_the_same_bytes(drawn: Drawn) -> None:
    killed = subprocess.run(
        [sys.executable, "-c", DIES_AT, "3", *words(drawn, "broken")], cwd=ROOT, capture_output=True, check=False
    )
    assert killed.returncode == -signal.SIGKILL, os.fsdecode(killed.stderr)
    assert [path.name for path in (drawn.folder / "broken").iterdir()] == ["training.safetensors"]
    assert train(drawn, "broken") == 0
    assert contents(drawn.folder / "broken") == contents(drawn.folder / "model")


def test_another_puppet_and_other_mistakes_are_refused_in_words(
    drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    write_cutout(draw_figure(1, False, DOLL).cutout, other)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    source, out = str(drawn.folder / "out"), str(tmp_path / "model")
    drawings = str(write_drawings(tmp_path / "drawings"))
    mistakes = {
        "expected the puppet of the run": [source, "--out", out, "--puppet", str(other)],
        "expected frames from 0 to 7": [source, "--out", out, "--hold-out", "99"],
        "expected frame numbers such as": [source, "--out", out, "--hold-out", "one"],
        "not a model's folder (found letter.txt)": [source, "--out", str(tmp_path / "full")],
        "with --puppet; found a folder without run.json": [drawings, "--out", out],
        "found nothing": [str(tmp_path / "nowhere"), "--out", out],
    }
    for message, arguments in mistakes.items():
        assert run_command(["train", *arguments, *TINY]) == 2
        error = capsys.readouterr().err
        assert message in error, error
        assert error.count("\n") == 1
    assert not Path(out).exists()


def test_a_model_is_refused_for_another_puppet(drawn: Drawn, tmp_path: Path) -> None:
    from wildpuppet.errors import InputError
    from wildpuppet.puppet.build import build
    from wildpuppet.settings import PuppetSettings

    other = build(draw_figure(1, False, DOLL).cutout, PuppetSettings(edge=0.25))
    with pytest.raises(InputError, match="trained for another puppet: expected 10 parts"):
        load_model(drawn.folder / "model", other)


def test_the_paper_learns_from_pictures_alone(drawn: Drawn, tmp_path: Path) -> None:
    drawings, out = write_drawings(tmp_path / "drawings"), tmp_path / "model"
    quick = ("--train.iterations=2", "--train.batch=2", "--train.encoder-pixels=16", "--train.code=8")
    sizes = ("--crop.box-pixels=48", "--puppet.edge=0.25")
    arguments = ["train", str(drawings), "--puppet", str(drawn.puppet), "--out", str(out), "--recipe", "paper"]
    assert run_command([*arguments, *quick, *sizes]) == 0
    model = load_model(out)
    assert model.recipe == "paper"
    assert model.train.code_relu
    assert model.is_on_paper
    codes = model.encode(np.zeros((1, model.size[1], model.size[0], 4), np.uint8))
    assert codes.min() >= 0
    vertices = model.decode(codes)
    near = model.decode(model.codes_of(vertices, start=codes + 0.05))
    assert np.linalg.norm(near - vertices, axis=-1).max() < 0.1


def test_frames_are_read_from_words() -> None:
    assert frames_of("3, 5,8-10") == [3, 5, 8, 9, 10]
    assert frames_of("") == []
    with pytest.raises(SettingsError, match="found '3-'"):
        frames_of("3-")


def test_crops_are_cut_as_the_run_saw_them(drawn: Drawn) -> None:
    """Recut pictures are those that the run kept, byte for byte; a clip that has changed is refused."""
    from wildpuppet.disk import load_crops
    from wildpuppet.errors import InputError

    run = open_run(drawn.folder / "out")
    (kept,) = (path.parent for path in (drawn.folder / "store").glob("entries/*/*/images.mkv"))
    np.testing.assert_array_equal(run_crops(run).images[:4][..., :3], load_crops(kept).images[:4][..., :3])
    changed = drawn.folder / "changed.mp4"
    changed.write_bytes(drawn.video.read_bytes() + b"\0")
    with pytest.raises(InputError, match="found another"):
        run_crops(run, changed)
