"""`wildpuppet inbetween` and `wildpuppet retarget` on a drawn clip: what they leave is a run like any other."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, Drawn, drawn_in, final_files
from tests.pipelines.test_mistakes import assert_one_clear_line
from wildpuppet.api import open_run
from wildpuppet.motion.bones import bone_tree_of, bones_of, turns_of
from wildpuppet.puppet.folder import read_cutout, write_cutout
from wildpuppet.types import CutOut, JointSpec, Part


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """A clip with a finished run on it."""
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    return drawn


def inbetween(drawn: Drawn, out: Path, *more: str) -> int:
    words = ["inbetween", str(drawn.folder / "out"), "--frames", "2", "5", "--count", "2", "--out", str(out)]
    return run_command([*words, *more])


def retarget(drawn: Drawn, to: Path, out: Path, *more: str) -> int:
    return run_command(["retarget", str(drawn.folder / "out"), "--to", str(to), "--out", str(out), *more])


def exact_files(out: Path) -> dict[str, bytes]:
    """All files but the film, whose encoder now and then gives other bytes for pictures as tiny as these."""
    return {name: found for name, found in final_files(out).items() if name not in ("preview.mp4", "run.json")}


def test_inbetweens_are_frames_with_alpha_and_a_run(drawn: Drawn, tmp_path: Path) -> None:
    out = tmp_path / "between"
    assert inbetween(drawn, out) == 0
    names = [f"inbetween.{number:05d}.png" for number in range(4)]
    assert sorted(path.name for path in (out / "frames").iterdir()) == names
    run, source = open_run(out), open_run(drawn.folder / "out")
    assert run.size == (1024, 768)
    scale = 1024 / 160
    keys = [source.animation.vertices(row) * scale for row in (2, 5)]
    for t, key in ((0, keys[0]), (3, keys[1])):
        assert np.abs(run.animation.vertices(t) - key).max() < 1e-3
    for t, name in enumerate(names):
        with Image.open(out / "frames" / name) as picture:
            alpha = np.asarray(picture)[..., 3]
        assert alpha.shape == (768, 1024)
        rows, columns = np.nonzero(alpha > 127)
        low, high = run.animation.vertices(t).min(0), run.animation.vertices(t).max(0)
        margin = 4.0 * scale + 2.0  # the mesh reaches this far beyond the drawing
        assert np.abs([columns.min() - low[0], rows.min() - low[1]]).max() < margin
        assert np.abs([columns.max() - high[0], rows.max() - high[1]]).max() < margin
    assert (out / "sheet.png").is_file()
    assert (out / "preview.mp4").is_file()
    assert run_command(["export", str(out), "--to", "glb", "--out", str(tmp_path / "files")]) == 0


def test_inbetweens_come_out_the_same_again(drawn: Drawn, tmp_path: Path) -> None:
    out = tmp_path / "between"
    assert inbetween(drawn, out, "--size", "64") == 0
    before = exact_files(out)
    assert inbetween(drawn, out, "--size", "64") == 0
    assert exact_files(out) == before
    assert inbetween(drawn, out, "--size", "64", "--method", "linear", "--around", "character") == 0
    with np.load(out / "meshes.npz") as meshes:
        inside = meshes["vertices_video"]
    assert inside.min() > 0.0
    assert inside.max() < 64.0
    straight = (2.0 * inside[0] + inside[3]) / 3.0
    assert np.abs(inside[1] - straight).max() < 1e-3


def test_mistakes_between_frames(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "between"
    assert_one_clear_line(inbetween(drawn, out, "--frames", "2", "99"), capsys, f"0 to {FRAMES - 1}", "99")
    assert_one_clear_line(inbetween(drawn, out, "--frames", "2", "2"), capsys, "--frames 2 2", "two drawings")
    assert_one_clear_line(inbetween(drawn, out, "--count", "0"), capsys, "--count 0", "1 to")
    assert_one_clear_line(inbetween(drawn, out, "--size", "0"), capsys, "--size 0")
    assert_one_clear_line(inbetween(drawn, out, "--method", "code"), capsys, "--model")
    run = str(drawn.folder / "out")
    assert_one_clear_line(run_command(["inbetween", run, "--out", str(out)]), capsys, "--frames")
    assert_one_clear_line(run_command(["inbetween", run, run, "--out", str(out)]), capsys, "--model")
    assert not out.exists()
    assert_one_clear_line(inbetween(drawn, drawn.folder / "out"), capsys, "did not make", "another folder")
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    assert_one_clear_line(inbetween(drawn, out), capsys, "not a run's folder")


def longer(cutout: CutOut, keep: tuple[str, ...]) -> CutOut:
    """The puppet on a canvas twice as high, its parts stretched with it, and other parts renamed."""
    width, height = cutout.canvas
    named = {part.name: part.name if part.name in keep else f"my {part.name}" for part in cutout.parts}
    parts = tuple(
        Part(named[part.name], np.asarray(Image.fromarray(part.rgba).resize((width, 2 * height))))
        for part in cutout.parts
    )
    joints = tuple(
        JointSpec(
            (named[joint.parts[0]], named[joint.parts[1]]), None if joint.at is None else (joint.at[0], 2 * joint.at[1])
        )
        for joint in cutout.joints
    )
    return CutOut((width, 2 * height), parts, joints)


def test_a_run_moves_another_puppet(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cutout = read_cutout(drawn.puppet)
    names = tuple(part.name for part in cutout.parts)
    write_cutout(longer(cutout, names), tmp_path / "long")
    assert retarget(drawn, tmp_path / "long", tmp_path / "moved") == 0
    assert f"{len(names)} parts follow" in capsys.readouterr().out
    source, moved = open_run(drawn.folder / "out"), open_run(tmp_path / "moved")
    assert moved.animation.timing.pts.tolist() == source.animation.timing.pts.tolist()
    assert moved.fit.state == source.fit.state
    turns = []
    for run in (source, moved):
        tree, animation = bone_tree_of(run.puppet), run.animation
        poses = np.stack([animation.vertices(t) for t in range(len(animation))])
        turns.append(turns_of(tree, bones_of(tree, poses)))
    away = np.angle(np.exp(1j * (turns[0] - turns[1])))
    assert np.abs(away).max() < 1e-3
    assert run_command(["export", str(tmp_path / "moved"), "--to", "usd", "--out", str(tmp_path / "files")]) == 0
    said = json.loads((tmp_path / "moved" / "run.json").read_text())["request"]["made_by"]
    assert said["matched"] == [[name, name] for name in names]


def test_mistakes_of_retargeting(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cutout = read_cutout(drawn.puppet)
    first = cutout.parts[0].name
    write_cutout(longer(cutout, ()), tmp_path / "other")
    assert_one_clear_line(
        retarget(drawn, tmp_path / "other", tmp_path / "no"), capsys, first, f"my {first}", "--match MINE=THEIRS"
    )
    assert not (tmp_path / "no").exists()
    matched = ("--match", f"my {first}={first}")
    assert retarget(drawn, tmp_path / "other", tmp_path / "one", *matched) == 0
    assert_one_clear_line(
        retarget(drawn, tmp_path / "other", tmp_path / "no", "--match", f"{first}=my {first}"), capsys, "--match"
    )
    assert_one_clear_line(retarget(drawn, drawn.puppet, tmp_path / "no", "--height", "0"), capsys, "--height 0")
    assert_one_clear_line(retarget(drawn, tmp_path / "none", tmp_path / "no"), capsys, "none")
    assert_one_clear_line(run_command(["status", str(tmp_path / "one")]), capsys, "wildpuppet retarget")
