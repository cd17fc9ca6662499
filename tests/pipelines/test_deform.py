"""`wildpuppet deform` on a drawn clip: what it writes, and mistakes told in one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, Drawn, drawn_in
from tests.pipelines.test_mistakes import assert_one_clear_line
from wildpuppet.api import open_run
from wildpuppet.correspond.locate import locate
from wildpuppet.errors import InputError

FRAME = 4
BY = np.array([9.0, -6.0])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """A clip with a finished run on it."""
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    assert drawn.run() == 0
    return drawn


def middle(drawn: Drawn, part: str) -> np.ndarray:
    """A vertex near the middle of a part in the frame, where it surely is on the part."""
    run = open_run(drawn.folder / "out")
    mine = run.animation.vertices(FRAME)[run.puppet.layer_of_vertex == run.puppet.names.index(part)]
    triangles = run.puppet.triangles[run.puppet.layer_of_triangle == run.puppet.names.index(part)]
    centres = run.animation.vertices(FRAME)[triangles].mean(1)
    return np.asarray(centres[np.linalg.norm(centres - mine.mean(0), axis=1).argmin()])


def handle(part: str, point: np.ndarray, target: np.ndarray) -> str:
    return f"{part}:{point[0]:.3f},{point[1]:.3f}->{target[0]:.3f},{target[1]:.3f}"


def deform(drawn: Drawn, out: Path, *more: str) -> int:
    return run_command(["deform", str(drawn.folder / "out"), "--frame", str(FRAME), "--out", str(out), *more])


@pytest.mark.parametrize("over", ["none", "white", "original", "plate"])
def test_a_dragged_frame_is_a_picture_and_a_run(drawn: Drawn, tmp_path: Path, over: str) -> None:
    source = open_run(drawn.folder / "out")
    part = source.puppet.names[0]
    point = middle(drawn, part)
    assert deform(drawn, tmp_path / "out", "--handle", handle(part, point, point + BY), "--over", over) == 0
    run = open_run(tmp_path / "out")
    anchor = locate(source.puppet, source.animation.vertices(FRAME), source.fit.order[FRAME], point[None], [part])
    np.testing.assert_allclose(anchor.mix(run.animation.vertices(0)[None])[0, 0], point + BY, atol=0.01)
    with np.load(tmp_path / "out" / "meshes.npz") as meshes:
        np.testing.assert_allclose(meshes["vertices_video"][0], run.animation.vertices(0), atol=1e-3)
        assert meshes["frames"].tolist() == [FRAME]
    with Image.open(tmp_path / "out" / "deformed.png") as opened:
        alone = np.asarray(opened)
    assert alone.shape == (120, 160, 4)
    assert alone[int(point[1] + BY[1]), int(point[0] + BY[0]), 3] > 100  # a thin limb
    with Image.open(tmp_path / "out" / "preview.png") as opened:
        assert opened.size == (320, 120)
    assert (tmp_path / "out" / "over.png").exists() == (over != "none")
    if over != "none":
        with Image.open(tmp_path / "out" / "over.png") as opened:
            laid = np.asarray(opened).astype(int)
        solid = alone[..., 3] == 255
        np.testing.assert_array_equal(laid[solid], alone[solid][:, :3])
    said = json.loads((tmp_path / "out" / "run.json").read_text())["request"]["made_by"]
    assert (said["command"], said["frame"], said["by"]) == ("deform", FRAME, "poses")


def test_the_plate_shows_where_the_character_was(drawn: Drawn, tmp_path: Path) -> None:
    """Dragged away as a whole, the character stands nowhere in the picture but at its new place."""
    run = open_run(drawn.folder / "out")
    handles = [handle(part, middle(drawn, part), middle(drawn, part) + 10 * BY) for part in run.puppet.names[:2]]
    flags = [word for text in handles for word in ("--handle", text)]
    assert deform(drawn, tmp_path / "plate", *flags, "--over", "plate") == 0
    assert deform(drawn, tmp_path / "as_is", *flags, "--over", "original") == 0
    pictures = [np.asarray(Image.open(tmp_path / name / "over.png")).astype(int) for name in ("plate", "as_is")]
    assert (np.abs(pictures[0] - pictures[1]).max(-1) > 40).sum() > 50


def test_what_it_leaves_can_be_exported(drawn: Drawn, tmp_path: Path) -> None:
    part = open_run(drawn.folder / "out").puppet.names[0]
    point = middle(drawn, part)
    assert deform(drawn, tmp_path / "out", "--handle", handle(part, point, point + BY)) == 0
    assert run_command(["export", str(tmp_path / "out"), "--to", "png", "--out", str(tmp_path / "exports")]) == 0
    assert len(list((tmp_path / "exports" / "png" / "combined").iterdir())) == 1


def test_points_at_rest_are_those_of_the_frame(drawn: Drawn) -> None:
    run = open_run(drawn.folder / "out")
    part = run.puppet.names[0]
    mine = np.flatnonzero(run.puppet.layer_of_vertex == 0)
    from_middle = np.linalg.norm(run.puppet.vertices[mine] - run.puppet.vertices[mine].mean(0), axis=1)
    vertex = int(mine[from_middle.argmin()])  # one at the border may lie under a fold of the bent part
    here, rest = run.animation.vertices(FRAME)[vertex], run.puppet.vertices[vertex]
    target = here + BY
    by_frame = run.deform(FRAME, [handle(part, here, target)])
    by_rest = run.deform(FRAME, [handle(f"{part}:@", rest, target).replace("@:", "@")])
    np.testing.assert_allclose(by_rest.vertices, by_frame.vertices, atol=0.05)


def test_handles_that_stay_keep_the_frame(drawn: Drawn) -> None:
    run = open_run(drawn.folder / "out")
    part = run.puppet.names[0]
    point = middle(drawn, part)
    found = run.deform(FRAME, [handle(part, point, point)])
    np.testing.assert_allclose(found.vertices, run.animation.vertices(FRAME), atol=0.02)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ((), ("--handle is needed",)),
        (("--handle", "torso"), ("--handle torso", "part:x,y->x,y")),
        (("--handle", "torso:1,2->3"), ("part:x,y->x,y",)),
        (("--handle", "torso:one,2->3,4"), ("part:x,y->x,y",)),
        (("--handle", "tail:1,2->3,4"), ("expected one of the puppet's parts", "'tail'", "torso")),
        (("--handle", "torso:159,119->3,4"), ("pixels outside of torso", "the frame")),
        (("--handle", "torso:@900,900->3,4"), ("pixels outside of torso", "the puppet at rest")),
        (("--handle", "torso:1,2->3,4", "--frame", str(FRAMES)), ("expected a frame of the run", f"found {FRAMES}")),
        (("--handle", "torso:1,2->3,4", "--model", "nowhere"), ("nowhere", "expected the MODEL folder")),
        (("--handle", "torso:1,2->3,4", "--over", "water"), ("water",)),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(
    drawn: Drawn, tmp_path: Path, flags: tuple[str, ...], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "torso" in open_run(drawn.folder / "out").puppet.names
    assert_one_clear_line(deform(drawn, tmp_path / "none", *flags), capsys, *words)
    assert not (tmp_path / "none").exists()


def test_other_files_are_not_overwritten(drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "drawing.txt").write_text("mine")
    point = middle(drawn, "torso")
    code = deform(drawn, tmp_path / "mine", "--handle", handle("torso", point, point + BY))
    assert_one_clear_line(code, capsys, "mine")
    assert (tmp_path / "mine" / "drawing.txt").read_text() == "mine"


def test_no_handle_at_all_is_a_mistake_from_python_too(drawn: Drawn) -> None:
    with pytest.raises(InputError, match="at least one handle"):
        open_run(drawn.folder / "out").deform(FRAME, [])
