import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import wildpuppet
from pipelines.cli import run_command
from tests.pipelines.drawn import (
    FRAMES,
    QUICK,
    REFERENCE,
    Drawn,
    drawn_in,
    final_files,
    made_now,
    scene,
    write_drawings,
)

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    return drawn


def test_out_holds_what_the_readme_says(drawn: Drawn) -> None:
    out = drawn.folder / "out"
    assert set(final_files(out)) == {
        "run.json", "exposure.csv", "meshes.npz", "atlas.png", "carry/puppet.npz", "carry/crops.npz", "carry/fit.npz",
    }  # fmt: skip
    run = json.loads((out / "run.json").read_text())
    assert run["schema"] == "wildpuppet.run/1"
    assert run["frames"] == list(range(FRAMES))
    assert run["size"] == [160, 120]
    assert len(run["state"]) == FRAMES
    assert all(len(losses) == FRAMES for losses in run["losses"].values())
    assert sum(run["states"].values()) == FRAMES
    assert run["worth_a_look"][0] == run["frames"][int(np.argmin(run["confidence"]))]
    assert run["request"]["settings"]["fit"]["steps"] == 3
    assert run["exposure"]["drawings"] == run["exposure"]["exposures"] == FRAMES
    assert (run["exposure"]["ones"], run["exposure"]["reused"]) == (1.0, 0)
    with (out / "exposure.csv").open(newline="") as file:
        assert [row["drawing"] for row in csv.DictReader(file)] == [str(index + 1) for index in range(FRAMES)]
    assert {"probe", "track", "crop", "fit"} <= set(json.loads((out / "timings.json").read_text())["seconds"])


def test_meshes_lie_on_the_video(drawn: Drawn) -> None:
    with np.load(drawn.folder / "out" / "meshes.npz") as meshes:
        vertices = meshes["vertices_video"][REFERENCE]
        assert meshes["vertices_video"].shape == (FRAMES, len(meshes["layer_of_vertex"]), 2)
    x, y, width, height = scene().boxes[REFERENCE]
    middle, side = np.array([x + width / 2, y + height / 2]), max(width, height)
    assert np.linalg.norm((vertices.min(0) + vertices.max(0)) / 2 - middle) < 0.2 * side


def test_second_run_makes_nothing_and_writes_the_same(drawn: Drawn, capsys: pytest.CaptureFixture[str]) -> None:
    before = final_files(drawn.folder / "out")
    assert drawn.run() == 0
    assert made_now(capsys.readouterr().err) == []
    assert final_files(drawn.folder / "out") == before
    assert drawn.run(out="elsewhere") == 0
    assert final_files(drawn.folder / "elsewhere") == before


def test_second_run_imports_nothing_heavy(drawn: Drawn) -> None:
    code = (
        "import sys\nfrom pipelines.cli import run_command\n"
        f"run_command({drawn.arguments()!r})\n"
        "print(sorted({'torch', 'cv2', 'numba', 'scipy', 'skimage'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_fresh_store_gives_the_same_bytes(drawn: Drawn) -> None:
    assert drawn.run(out="again", store="other store") == 0
    assert final_files(drawn.folder / "again") == final_files(drawn.folder / "out")


def test_changed_fit_setting_reruns_only_fit_and_what_follows_and_status_says_why(
    drawn: Drawn, capsys: pytest.CaptureFixture[str]
) -> None:
    store = ["--store", str(drawn.folder / "store")]
    assert run_command(["status", str(drawn.folder / "out"), *store]) == 0
    assert "would run" not in capsys.readouterr().out
    assert run_command(["status", str(drawn.folder / "out"), *store, "--fit.area", "0.2"]) == 0
    _, *steps, advice = capsys.readouterr().out.splitlines()
    told = dict(line.split(maxsplit=1) for line in steps)
    assert f"{FRAMES} frames, " in advice
    assert "most worth a look" in advice
    assert told["fit"] == "would run because settings.fit.area 0.002 -> 0.2"
    assert {step for step, words in told.items() if words != "kept"} == {"fit", "confidence", "exposure", "meshes"}
    assert drawn.run("--fit.area", "0.2", out="changed") == 0
    assert made_now(capsys.readouterr().err) == ["fit", "confidence", "exposure", "meshes"]


def test_redo_makes_one_stage_anew_and_what_follows_stays_when_it_comes_out_the_same(
    drawn: Drawn, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drawn.run("--redo", "track") == 0
    assert made_now(capsys.readouterr().err) == ["track"]


def test_until_stops_after_a_stage_and_writes_no_out(drawn: Drawn, capsys: pytest.CaptureFixture[str]) -> None:
    assert drawn.run("--until", "track", out="none") == 0
    told = capsys.readouterr()
    assert [line.split(":")[0] for line in told.err.splitlines()] == ["probe", "puppet", "track"]
    assert told.out == f"stopped after track; {drawn.folder / 'none'} is not written\n"
    assert not (drawn.folder / "none").exists()


def test_run_carries_points_when_the_store_is_gone_and_the_run_has_moved(drawn: Drawn, tmp_path: Path) -> None:
    moved = shutil.copytree(drawn.folder / "out", tmp_path / "moved")
    torso = scene().layer("torso")
    points = scene().truth(np.array([[128.0, 120.0], [128.0, 130.0]]), torso)[REFERENCE]
    (tmp_path / "points.csv").write_text("".join(f"{x},{y},torso\n" for x, y in points))
    words = ["points", str(moved), str(tmp_path / "points.csv"), "--frame", str(REFERENCE)]
    assert run_command([*words, "--out", str(tmp_path / "tracks.npz")]) == 0
    with np.load(tmp_path / "tracks.npz") as tracks:
        assert tracks["points"].shape == (FRAMES, 2, 2)
        assert tracks["points"].dtype == np.float32
        assert tracks["visible"].dtype == np.bool_
        assert tracks["frames"].tolist() == list(range(FRAMES))
        np.testing.assert_allclose(tracks["points"][REFERENCE], points, atol=1e-4)
        carried = tracks["points"]
    run = wildpuppet.open_run(moved)
    np.testing.assert_allclose(run.carry(points, REFERENCE, ["torso", "torso"]).points_video, carried, atol=1e-3)
    words = ["flow", str(moved), "--from", "0", "--to", str(REFERENCE), "--out", str(tmp_path / "flow.npz")]
    assert run_command(words) == 0
    with np.load(tmp_path / "flow.npz") as flow:
        assert flow["flow"].shape == (120, 160, 2)
        assert np.isfinite(flow["flow"]).any()


def test_python_api_does_what_the_command_does(drawn: Drawn) -> None:
    settings = {
        "crop": {"box_pixels": 64, "matte": False},
        "search": {"enabled": False},
        "puppet": {"edge": 0.25},
        "fit": {"steps": 3},
        "out": {"preview": False},
    }
    box = tuple(float(side) for side in drawn.box.split(","))
    where = {"out": drawn.folder / "api", "store": drawn.folder / "store", "puppet": drawn.puppet}
    run = wildpuppet.run(drawn.video, box, at=REFERENCE, settings=settings, **where)
    assert final_files(run.folder) == final_files(drawn.folder / "out")


def test_files_of_the_run_before_go_and_the_users_stay(drawn: Drawn) -> None:
    assert drawn.run("--out.meshes", "obj", out="again2") == 0
    out = drawn.folder / "again2"
    assert len(list((out / "meshes").glob("frame_*.obj"))) == FRAMES
    (out / "notes.txt").write_text("mine")
    (out / "meshes" / "frame_000001.obj").write_text("edited by hand")
    assert drawn.run(out="again2") == 0
    assert (out / "notes.txt").read_text() == "mine"
    assert [path.name for path in (out / "meshes").iterdir()] == ["frame_000001.obj"]


def test_automatic_puppet_is_written_and_never_over_a_persons_work(
    drawn: Drawn, capsys: pytest.CaptureFixture[str]
) -> None:
    words = drawn.arguments(out="automatic")
    place = words.index("--puppet")
    del words[place : place + 2]
    assert run_command(words) == 0
    folder = drawn.folder / "automatic" / "puppet"
    assert run_command(["puppet", "check", str(folder)]) in (0, 1)
    assert run_command(words) == 0
    part = sorted((folder / "parts").iterdir())[0]
    picture = Image.open(part)
    picture.putpixel((0, 0), (1, 2, 3, 4))
    picture.save(part)
    edited = part.read_bytes()
    capsys.readouterr()
    assert run_command(words) == 2
    assert f"--puppet {folder}" in capsys.readouterr().err
    assert part.read_bytes() == edited
    files = final_files(folder)
    for _ in range(2):
        assert run_command([*words, "--puppet", str(folder)]) == 0
        assert final_files(folder) == files
    assert part.read_bytes() == edited


def test_drawings_are_fitted_in_file_order(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_drawings(tmp_path / "drawings")
    words = ["fit", str(folder), "--puppet", str(drawn.puppet), "--out", str(tmp_path / "run"), "--test-share", "0.25"]
    words += ["--store", str(drawn.folder / "store"), *QUICK]
    assert run_command(words) == 0
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["names"] == [f"{index:02d}.png" for index in range(FRAMES)]
    assert len(run["test"]) == FRAMES // 4
    capsys.readouterr()
    assert run_command(["status", str(tmp_path / "run"), "--store", str(drawn.folder / "store")]) == 0
    assert "would run" not in capsys.readouterr().out


def test_prune_clears_what_no_run_refers_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = drawn_in(tmp_path)
    store = ["--store", str(tmp_path / "store")]
    assert drawn.run() == 0
    assert drawn.run("--fit.steps", "2", out="second") == 0
    assert run_command(["prune", *store]) == 0
    assert "cleared 0 results" in capsys.readouterr().out
    shutil.rmtree(tmp_path / "second")
    assert run_command(["prune", *store]) == 0
    assert "cleared 5 results" in capsys.readouterr().out
    assert drawn.run() == 0
    assert made_now(capsys.readouterr().err) == []


def test_status_of_a_video_shows_every_run_on_it_with_its_own_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = drawn_in(tmp_path)
    store = ["--store", str(tmp_path / "store")]
    assert drawn.run("--until", "puppet", out="first") == 0
    assert drawn.run("--until", "puppet", "--puppet.edge", "0.3", out="second") == 0
    capsys.readouterr()
    assert run_command(["status", str(drawn.video), *store]) == 0
    told = capsys.readouterr().out
    assert [line.split()[-5] for line in told.splitlines() if "->" in line and "clip.mp4" in line] == [
        str(tmp_path / "first"),
        str(tmp_path / "second"),
    ]
    assert told.count("puppet      kept") == 2
    assert told.count("stopped before its end") == 2
    assert run_command(["status", str(drawn.video), *store, "--puppet.margin", "5"]) == 0
    assert capsys.readouterr().out.count("would run because settings.puppet.margin 4.0 -> 5.0") == 2
