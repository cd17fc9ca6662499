"""`--keyframe` as a user gives it: where points end, what runs again, what status says, and mistakes in one line."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import wildpuppet
from pipelines import fit_frames
from pipelines.cli import run_command
from tests.fit.arms import FRAMES, HAND, cutout, draw
from tests.pipelines.drawn import final_files, made_now
from wildpuppet.geometry import affine
from wildpuppet.pose import follow
from wildpuppet.puppet.folder import write_cutout
from wildpuppet.video.write import write_preview

KEY = 7
SETTINGS = {
    "crop": {"matte": False, "box_pixels": 64},
    "puppet": {"edge": 0.2},
    "search": {"box_pixels": 32, "angles": 24, "num_best": 3},
    "fit": {"steps": 6},
    "out": {"preview": False},
}
QUICK = [
    f"--{table}.{name.replace('_', '-')}={value}" for table, names in SETTINGS.items() for name, value in names.items()
]
POINT_PIXELS = 1.0
"""Where a given point ends, at most, from where it was told to be."""


@dataclass(frozen=True)
class Clip:
    """Where the clip and the puppet lie."""

    folder: Path

    def run(self, *more: str, out: str) -> int:
        words = ["run", str(self.folder / "clip.mp4"), "--bbox", "8,2,96,88", "--puppet", str(self.folder / "puppet")]
        where = ["--out", str(self.folder / out), "--store", str(self.folder / "store")]
        return run_command([*words, *where, *QUICK, *more])

    def points(self, name: str, x: float, y: float) -> str:
        """Write a points file for the first arm's hand; give it as --keyframe takes it."""
        (self.folder / name).write_text(f"part,canvas_x,canvas_y,x,y\nfirst,{HAND[0]},{HAND[1]},{x},{y}\n")
        return f"{KEY}:{self.folder / name}"

    def point_of(self, out: str, frame: int = KEY) -> np.ndarray:
        """Where the hand is in a run's frame."""
        run = wildpuppet.open_run(self.folder / out)
        rest = run.puppet.vertices[run.puppet.layer_of_vertex == 1]
        with np.load(self.folder / out / "meshes.npz") as meshes:
            posed = meshes["vertices_video"][frame][meshes["layer_of_vertex"] == 1]
        known = np.column_stack([rest, np.ones(len(rest))])
        near = np.exp(-(((rest - HAND) ** 2).sum(1)) / 60)[:, None]
        return np.array([*HAND, 1.0]) @ np.linalg.lstsq(known * near, posed * near, rcond=None)[0]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Clip]:
    """The clip, run once without keyframes, three frames a chunk; a keyframe is carried to the next drawing only."""
    clip = Clip(tmp_path_factory.mktemp("arms"))
    times = np.arange(FRAMES), Fraction(1, 24)
    write_preview(clip.folder / "clip.mp4", list(draw().crops.images[:][..., :3]), *times)
    write_cutout(cutout(), clip.folder / "puppet")
    with pytest.MonkeyPatch.context() as small:
        small.setattr(fit_frames, "CHUNK", 3)
        small.setattr(follow, "FOLLOWED_DRAWINGS", 1)
        assert clip.run(out="plain") == 0
        yield clip


def made(clip: Clip, out: str) -> list[str]:
    return json.loads((clip.folder / out / "timings.json").read_text())["made_now"]


def test_a_point_ends_where_it_was_put_and_only_what_depends_on_it_runs_again(
    clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = final_files(clip.folder / "plain")
    x, y = clip.point_of("plain") + np.array([2.5, -2.0])
    flag = clip.points("hand.csv", x, y)
    assert clip.run("--keyframe", flag, out="keyed") == 0
    assert np.linalg.norm(clip.point_of("keyed") - (x, y)) < POINT_PIXELS
    again = {"keyframes.part", "keyframes", "choose", "fit.keyed", "fit", "confidence", "exposure", "meshes"}
    assert set(made(clip, "keyed")) == again
    assert made_now(capsys.readouterr().err)[0] == "keyframes"
    assert clip.run(out="plain") == 0
    assert final_files(clip.folder / "plain") == plain
    store = ["--store", str(clip.folder / "store")]
    capsys.readouterr()
    assert run_command(["status", str(clip.folder / "keyed"), *store]) == 0
    assert "would run" not in capsys.readouterr().out
    clip.points("hand.csv", x - 4, y)
    assert run_command(["status", str(clip.folder / "keyed"), *store]) == 0
    told = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()[1:]]
    verdicts = {words[0]: words[1] for words in told}
    assert verdicts["keyframes"].startswith("would run because keyframe changed")
    assert verdicts["search"] == "kept"
    assert clip.run("--keyframe", flag, out="keyed") == 0
    assert set(made(clip, "keyed")) == again
    assert np.linalg.norm(clip.point_of("keyed") - (x - 4, y)) < POINT_PIXELS


def test_a_corrected_pose_is_kept_and_the_api_takes_it(clip: Clip) -> None:
    with np.load(clip.folder / "plain" / "meshes.npz") as meshes:
        corrected = meshes["vertices_video"][4] + np.float32([1.5, 0.5])
    np.savez(clip.folder / "pose.npz", vertices_video=corrected)
    assert clip.run("--keyframe", f"4:{clip.folder / 'pose.npz'}", out="pose") == 0
    with np.load(clip.folder / "pose" / "meshes.npz") as meshes:
        np.testing.assert_allclose(meshes["vertices_video"][4], corrected, atol=1e-3)
    box, where = (8.0, 2.0, 96.0, 88.0), {"puppet": clip.folder / "puppet", "store": clip.folder / "store"}
    keyframes, out = {4: clip.folder / "pose.npz"}, clip.folder / "api"
    run = wildpuppet.run(clip.folder / "clip.mp4", box, keyframes=keyframes, out=out, settings=SETTINGS, **where)
    kept = affine.apply(run.crops.video_from_crop[4], run.fit.vertices_crop[4].astype(np.float64))
    np.testing.assert_allclose(kept, corrected, atol=1e-3)
    request = json.loads((clip.folder / "pose" / "run.json").read_text())["request"]
    assert request["keyframes"] == [[4, str(clip.folder / "pose.npz")]]
    assert "keyframes" not in json.loads((clip.folder / "plain" / "run.json").read_text())["request"]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda clip: "hand.csv", ("--keyframe hand.csv", "FRAME:FILE")),
        (lambda clip: "99:hand.csv", ("--keyframe 99:hand.csv", "0 to 8")),
        (lambda clip: "3:absent.csv", ("absent.csv", "found none")),
        (lambda clip: clip.points("nan.csv", float("nan"), 1.0), ("nan.csv, line 2", "four numbers")),
    ],
)
def test_mistakes_are_told_in_one_line_before_the_slow_stages(
    clip: Clip, make: object, words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(make)
    capsys.readouterr()
    assert clip.run("--keyframe", make(clip), "--track.smooth-frames", "1", out="none") == 2
    *before, complaint = capsys.readouterr().err.splitlines()
    assert complaint.startswith("wildpuppet: ")
    assert all(word in complaint for word in words)
    assert not any(line.startswith("track") for line in before)
    assert not (clip.folder / "none").exists()


def test_modes_that_cannot_keep_to_it_say_so(clip: Clip, capsys: pytest.CaptureFixture[str]) -> None:
    flag = clip.points("hand.csv", 40.0, 60.0)
    assert clip.run("--keyframe", flag, "--search.enabled", "False", out="none") == 2
    assert "--keyframe: expected search.enabled true" in capsys.readouterr().err
    assert clip.run("--keyframe", flag, "--keyframe", flag, out="none") == 2
    assert f"frame {KEY} has one already" in capsys.readouterr().err
