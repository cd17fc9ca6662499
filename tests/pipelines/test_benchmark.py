import json
import re
from pathlib import Path

import pytest

from pipelines.cli import run_command
from pipelines.time_renderer import measure_renderer
from pipelines.time_run import flow_lines, stage_lines
from tests.pipelines.drawn import FRAMES, drawn_in


def test_bench_prints_a_row_per_size_and_renderer(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["bench", "--sizes", "24", "32", "--seconds", "0.01"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    named = [words for side in ("24", "32") for words in ([side, "cpu"], [side, "reference"], ["ratio"])]
    assert [row[:-2] for row in rows] == named
    assert all(float(number) > 0 for row in rows for number in row[-2:])


def test_rows_say_what_was_timed() -> None:
    (row,) = measure_renderer((24,), ("cpu",), num_frames=2, seconds=0.01)
    assert (row.pixels, row.backend) == (24, "cpu")


def test_stages_of_a_run_in_frames_per_second(tmp_path: Path) -> None:
    run = {"schema": "wildpuppet.run/1", "is_finished": True, "frames": [3, 4, 5, 6, 7, 8]}
    (tmp_path / "run.json").write_text(json.dumps(run))
    (tmp_path / "timings.json").write_text(json.dumps({"seconds": {"search": 4.0, "fit": 2.0}}))
    rows = [line.split() for line in stage_lines(tmp_path)[2:]]
    assert rows == [["search", "4.0", "1.50"], ["fit", "2.0", "3.00"], ["all", "6.0", "1.00"]]


def test_flow_is_timed_over_the_frames_of_the_run(tmp_path: Path) -> None:
    drawn = drawn_in(tmp_path)
    request = {"source": str(drawn.video), "puppet": None, "settings": {}, "box_video": [1, 1, 9, 9], "at": 2}
    run = {"schema": "wildpuppet.run/1", "is_finished": True, "frames": list(range(2, FRAMES)), "size": [160, 120]}
    (tmp_path / "run.json").write_text(json.dumps({**run, "request": request}))
    (tmp_path / "timings.json").write_text(json.dumps({"seconds": {"search": 4.0, "fit": 2.0}}))
    (line,) = flow_lines(tmp_path)
    told = re.fullmatch(r"DIS flow +[\d.]+ +([\d.]+)   the run took \d+ times as long", line)
    assert told is not None
    assert float(told[1]) > 0
    drawn.video.unlink()
    assert flow_lines(tmp_path) == [f"{drawn.video} is no longer there: no optical flow to compare with"]


def test_what_cannot_be_timed_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["bench", str(tmp_path)]) == 2
    assert "expected the OUT folder of a run" in capsys.readouterr().err
    assert run_command(["bench", "--sizes", "0"]) == 2
    assert "expected --sizes, --seconds and --threads above 0" in capsys.readouterr().err
