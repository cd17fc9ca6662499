import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pipelines import evaluate
from wildpuppet.errors import InputError
from wildpuppet.types import PointTracks

POINTS = np.array([[30.0, 40.0], [70.0, 50.0], [50.0, 60.0]])


def make_set(folder, names=None):
    """Three drawings of a square that jumps right by 8 pixels, its corners marked; the first is the reference."""
    (folder / "frames").mkdir(parents=True)
    (folder / "puppet").mkdir()
    for number in range(3):
        picture = np.full((100, 120, 3), 255, np.uint8)
        cv2.rectangle(picture, (30 + 8 * number, 30), (70 + 8 * number, 70), (30, 90, 200), -1)
        cv2.imwrite(str(folder / "frames" / f"{number}.png"), picture)
    points = POINTS + np.array([8.0, 0.0]) * np.arange(3)[:, None, None]
    more = {} if names is None else {"names": np.array(names)}
    np.savez(
        folder / "gt.npz", points=points, visible=np.ones((3, 3), bool), part=np.array([0, 1, 1]), reference=0,
        canvas=np.array([120, 100]), test=np.array([2]), **more,
    )  # fmt: skip
    return points


@pytest.fixture
def perfect_run(monkeypatch):
    """A stand-in for the pipeline that carries every point exactly and remembers which parts it was told."""
    asked = []

    def run_case(case, truth, arguments, reporter):
        def carry(points, frame, parts):
            asked.append((points.tolist(), frame, parts))
            return PointTracks(np.arange(3), truth.points.astype(float), truth.visible, np.ones((3, 3)))

        return SimpleNamespace(puppet=SimpleNamespace(names=("body", "arm")), carry=carry)

    monkeypatch.setattr(evaluate, "run_case", run_case)
    return asked


def test_the_table_has_every_method_and_the_means_of_both_groups(tmp_path, perfect_run, capsys):
    make_set(tmp_path / "bench" / "fox", ["Left-Hand", "Right-Hand", "Head"])
    make_set(tmp_path / "bench" / "robot")
    arguments = evaluate.Arguments(bench_dirs=(tmp_path / "bench",), work=tmp_path / "work")
    evaluate.main(arguments)
    assert perfect_run[0] == (POINTS.tolist(), 0, ["body", "arm", "arm"])
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert lines[1][:5] == ["fox", "all", "copy", "50.0", "0.0"]  # 8 and 16 px off, allowed are 12 and 6
    assert lines[-2][:7] == ["mean", "of", "1", "rigs", "test", "ours", "100.0"]
    results = json.loads((tmp_path / "work" / "results.json").read_text())
    assert results["schema"] == "wildpuppet.evaluation/1"
    ours = [row for row in results["rows"] if row["method"] == "ours"]
    assert [(row["name"], row["frames"]) for row in ours] == [
        ("fox", "all"), ("fox", "test"), ("robot", "all"), ("robot", "test"),
        ("mean of 1 hand", "all"), ("mean of 1 hand", "test"), ("mean of 1 rigs", "all"), ("mean of 1 rigs", "test"),
    ]  # fmt: skip
    assert all(row["score"]["pck"] == dict.fromkeys(("0.1", "0.05", "0.025", "0.0125"), 100.0) for row in ours)
    assert sorted(results["seconds"]) == ["fox/drawings", "robot/drawings"]


def test_what_is_not_a_benchmark_is_refused(tmp_path):
    make_set(tmp_path / "fox")
    with pytest.raises(InputError, match="found no clips"):
        evaluate.cases_in(tmp_path / "fox", "clips")
    for folder in (tmp_path / "fox" / "frames", tmp_path / "absent"):
        with pytest.raises(InputError, match="found no drawings or clips"):
            evaluate.cases_in(folder, None)
