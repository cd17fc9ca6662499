import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from PIL import Image

from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, Drawn, drawn_in


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    return drawn_in(tmp_path_factory.mktemp("drawn"))


def assert_one_clear_line(code: int, capsys: pytest.CaptureFixture[str], *words: str) -> None:
    captured = capsys.readouterr()
    complaint = [line for line in captured.err.splitlines() if line.startswith("wildpuppet: ")]
    assert code == 2
    assert captured.err.splitlines()[-1:] == complaint
    assert "Traceback" not in captured.err
    for word in words:
        assert word in complaint[0]


def folder_video(drawn: Drawn) -> str:
    return str(drawn.folder)


def text_video(drawn: Drawn) -> str:
    path = drawn.folder / "notes.mp4"
    path.write_text("not a video at all")
    return str(path)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda drawn: str(drawn.folder / "nothing.mp4"), ("nothing.mp4", "no such file")),
        (folder_video, ("expected a video file", "folder")),
        (text_video, ("notes.mp4", "expected a video file")),
    ],
)
def test_video_that_is_none(
    drawn: Drawn, make: Callable[[Drawn], str], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = drawn.arguments(out="none")
    arguments[1] = make(drawn)
    assert_one_clear_line(run_command(arguments), capsys, *words)
    assert not (drawn.folder / "none").exists()


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--start", "5", "--end", "5", "--at", "5"), ("no frames in range", "START <= frame < END")),
        (("--start", str(FRAMES + 9),), ("no frames in range",)),
        (("--start", "-2"), ("no frames in range",)),
        (("--end", str(FRAMES + 1)), (f"the clip has {FRAMES} frames",)),
        (("--at", str(FRAMES)), ("--at", "expected a frame of the range")),
        (("--bbox", "10,10,0,30"), ("no area",)),
        (("--bbox", "10,10,-5,30"), ("no area",)),
        (("--bbox", "10,nan,5,30"), ("expected four numbers",)),
        (("--bbox", "500,10,20,30"), ("outside the frame", "160 x 120")),
        (("--fit.stepz", "3"), ("unknown setting --fit.stepz", "did you mean --fit.steps")),
        (("--fit.area", "-3"), ("setting fit.area", ">= 0", "found -3")),
        (("--fit.steps", "many"), ("--fit.steps", "many")),
        (("--config", "papr"), ("did you mean paper",)),
        (("--until", "fitt"), ("--until fitt", "track")),
        (("--redo", "all"), ("--redo all",)),
        (("--device", "gpu"), ("gpu", "cuda")),
        (("--puppet", "nowhere"), ("nowhere", "puppet.json")),
    ],
)  # fmt: skip
def test_range_box_and_settings(
    drawn: Drawn, flags: tuple[str, ...], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert_one_clear_line(drawn.run(*flags, out="none"), capsys, *words)
    assert not (drawn.folder / "none").exists()


def test_cuda_where_there_is_none(
    drawn: Drawn, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert_one_clear_line(drawn.run("--device", "cuda", out="none"), capsys, "expected a CUDA device", "--device auto")
    assert not (drawn.folder / "none").exists()


def break_json(folder: Path) -> None:
    (folder / "puppet.json").write_text('{"schema": ')


def lose_an_image(folder: Path) -> None:
    sorted((folder / "parts").iterdir())[0].unlink()


def resize_an_image(folder: Path) -> None:
    path = sorted((folder / "parts").iterdir())[0]
    Image.open(path).resize((20, 10)).save(path)


def name_a_stranger(folder: Path) -> None:
    path = folder / "puppet.json"
    tree = json.loads(path.read_text())
    tree["joints"] = [{"parts": ["torso", "tail"]}]
    path.write_text(json.dumps(tree))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (break_json, ("puppet.json", "not valid JSON")),
        (lose_an_image, ("missing", "parts/")),
        (resize_an_image, ("20 x 10",)),
        (name_a_stranger, ("tail",)),
    ],
)
def test_puppet_that_cannot_be_read(
    tmp_path: Path, damage: Callable[[Path], None], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = drawn_in(tmp_path)
    damage(drawn.puppet)
    assert_one_clear_line(drawn.run(), capsys, *words)
    assert_one_clear_line(run_command(["puppet", "check", str(drawn.puppet)]), capsys, *words)


def test_full_disk_loses_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = drawn_in(tmp_path)
    assert drawn.run("--until", "puppet") == 0

    def refuse(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as full:
        full.setattr(os, "fsync", refuse)
        assert_one_clear_line(drawn.run("--until", "track"), capsys, "disk is full", "free some space", "is kept")
    assert drawn.run("--until", "puppet") == 0
    assert "puppet: kept" in capsys.readouterr().err


def test_store_of_a_newer_version(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = drawn_in(tmp_path)
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "store.json").write_text('{"schema": "wildpuppet.store/99"}')
    assert_one_clear_line(drawn.run(), capsys, "newer wildpuppet", "update wildpuppet")


def test_out_of_a_newer_version_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = drawn_in(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.json").write_text('{"schema": "wildpuppet.run/99"}')
    assert_one_clear_line(drawn.run(), capsys, "newer wildpuppet", "update wildpuppet")


def test_store_that_is_somebody_elses_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = drawn_in(tmp_path)
    assert_one_clear_line(drawn.run(store="puppet"), capsys, "not a store")
    assert sorted(item.name for item in drawn.puppet.iterdir()) == ["parts", "puppet.json"]


def test_out_that_is_somebody_elses_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = drawn_in(tmp_path)
    assert_one_clear_line(drawn.run(out="puppet"), capsys, "not a run's folder", "run.json")
    assert sorted(item.name for item in drawn.puppet.iterdir()) == ["parts", "puppet.json"]
    assert_one_clear_line(drawn.run(out="clip.mp4"), capsys, "expected a folder")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["points", "nowhere", "points.csv", "--frame", "1", "--out", "a.npz"], "expected the OUT folder of a run"),
        (["flow", "nowhere", "--from", "0", "--to", "1", "--out", "a.npz"], "expected the OUT folder of a run"),
        (["status", "nowhere"], "knows no run"),
        (["fit", "nowhere", "--puppet", "nowhere", "--out", "a"], "nowhere"),
        (["puppet", "check", "nowhere"], "nowhere"),
        (["evaluate", "nowhere"], "nowhere"),
        (["evaluate"], "BENCH_DIR is needed"),
        (["rnu"], "unknown command rnu; did you mean run?"),
        (["puppet"], "did you mean puppet check?"),
        (["status"], "RUN|VIDEO is needed"),
        (["points", "nowhere"], "POINTS.csv and --frame FRAME and --out TRACKS.npz are needed"),
    ],
)
def test_other_commands_say_what_they_expected(
    words: list[str],
    complaint: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_one_clear_line(run_command(words), capsys, complaint)
    assert not list(tmp_path.iterdir())
