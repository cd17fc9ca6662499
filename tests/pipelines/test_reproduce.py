"""The paper's tables on a drawn benchmark of six drawings: every method answers, and nothing is made twice."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from pipelines import evaluate, paper_tables
from pipelines.cli import run_command
from wildpuppet.puppet.folder import write_cutout
from wildpuppet.types import CutOut, JointSpec, Part

SIZE = (160, 120)
FINE = 4
HINGE = np.array([88.0, 62.0])
DEGREES = (0.0, 7.0, -6.0, 12.0, -10.0, 4.0)
REFERENCE, TEST = 0, [1, 4]
QUICK = (
    "--crop.box-pixels=80", "--crop.matte=False", "--search.enabled=False", "--puppet.edge=0.2", "--fit.steps=40",
    "--out.preview=False",
)  # fmt: skip


def art(name: str) -> np.ndarray:
    """A spotted body or a striped arm, RGBA at FINE times the canvas."""
    picture = np.zeros((FINE * SIZE[1], FINE * SIZE[0], 4), np.uint8)
    if name == "body":
        cv2.ellipse(picture, (FINE * 64, FINE * 64), (FINE * 34, FINE * 40), 0, 0, 360, (60, 120, 190, 255), -1)
        for x, y in ((50, 50), (74, 44), (60, 76), (82, 84), (46, 88), (64, 60)):
            cv2.circle(picture, (FINE * x, FINE * y), FINE * 5, (230, 220, 90, 255), -1)
    else:
        cv2.rectangle(picture, (FINE * 80, FINE * 54), (FINE * 140, FINE * 70), (190, 60, 50, 255), -1)
        for x in range(88, 140, 12):
            cv2.rectangle(picture, (FINE * x, FINE * 54), (FINE * (x + 5), FINE * 70), (40, 150, 60, 255), -1)
    return picture


def turned(degrees: float, by: float) -> np.ndarray:
    """Place the arm: turned about its hinge and shifted with the body."""
    turn = cv2.getRotationMatrix2D(tuple(HINGE), degrees, 1.0)
    turn[0, 2] += by
    return turn


def drawn(matrices: dict[str, np.ndarray]) -> np.ndarray:
    """Draw the parts, each placed by its matrix, at the canvas' size."""
    fine = np.diag([FINE, FINE, 1.0])
    result = np.zeros((FINE * SIZE[1], FINE * SIZE[0], 4), np.uint8)
    for name, matrix in matrices.items():
        whole = fine @ np.vstack([matrix, [0, 0, 1]]) @ np.linalg.inv(fine)
        part = cv2.warpAffine(art(name), whole[:2], result.shape[1::-1], flags=cv2.INTER_NEAREST)
        result[part[..., 3] > 0] = part[part[..., 3] > 0]
    weights = result[..., 3:].astype(np.float32) / 255.0
    small = cv2.resize(np.dstack([result[..., :3] * weights, 255.0 * weights]), SIZE, interpolation=cv2.INTER_AREA)
    alpha = np.maximum(small[..., 3:], 1e-3) / 255.0
    return np.clip(np.dstack([small[..., :3] / alpha, small[..., 3:]]).round(), 0, 255).astype(np.uint8)


def make_bench(folder: Path) -> Path:
    """One set, as the benchmark has them: a body that shifts and an arm that turns, points on both."""
    bench = folder / "bench" / "doll"
    (bench / "frames").mkdir(parents=True)
    still = np.eye(2, 3)
    parts = tuple(Part(name, drawn({name: still})) for name in ("body", "arm"))
    write_cutout(CutOut(SIZE, parts, (JointSpec(("body", "arm"), tuple(HINGE)),)), bench / "puppet")
    rest = [np.array([[50.0, 50], [74, 44], [46, 88], [60, 76]]), np.array([[100.0, 62], [124, 62], [134, 58]])]
    points = []
    for index, degrees in enumerate(DEGREES):
        placed = [np.array([[1.0, 0, 2.0 * (index % 3)], [0, 1, 0]]), turned(degrees, 2.0 * (index % 3))]
        Image.fromarray(drawn(dict(zip(("body", "arm"), placed, strict=True)))).save(bench / f"frames/{index}.png")
        points.append(np.concatenate([spots @ m[:, :2].T + m[:, 2] for spots, m in zip(rest, placed, strict=True)]))
    np.savez(
        bench / "gt.npz", points=np.stack(points), visible=np.ones((len(DEGREES), 7), bool),
        part=np.array([0, 0, 0, 0, 1, 1, 1]), reference=REFERENCE, test=np.array(TEST), canvas=np.array(SIZE),
    )  # fmt: skip
    return bench.parent


def words_of(folder: Path, *more: str) -> list[str]:
    places = ["--store", str(folder / "store"), "--out", str(folder / "out")]
    return ["reproduce", str(make_bench(folder) if not (folder / "bench").exists() else folder / "bench"), *places,
            "--quick", *QUICK, *more]  # fmt: skip


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
    assert {method for method, measure in value if measure.startswith(("mse", "pck"))} == methods
    assert 0.0 < value["linear", "inbetween vertices"] < 10.0
    assert value["ours", "drag 3"] < 0.5 * value["start", "drag 3"]
    assert "Table 3" in text
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
