"""The exposure sheet, read back by Python's own csv reader, against timing made up by hand."""

import csv
from fractions import Fraction
from pathlib import Path

import numpy as np

from wildpuppet.export.exposure import exposures_of, summary_of, write_exposure
from wildpuppet.types import Clip, Crops, Fit

#         ones  twos  threes    back  lost  ones after it, a new shot on fours
NUMBERS = [0,   1, 1, 2, 2, 2,  1, 1, 3,    1,   5, 5, 5, 5]  # fmt: skip
SHOT = [0] * 10 + [1] * 4
LOST = 8
FIRST = 30


def values() -> tuple[np.ndarray, Crops, Fit, Clip]:
    number, frames = len(NUMBERS), np.arange(FIRST, FIRST + len(NUMBERS))
    state = tuple("lost" if index == LOST else "fitted" for index in range(number))
    crops = Crops(
        frames, (8, 8), np.zeros((number, 2, 3)), np.zeros((number, 8, 8, 4), np.uint8), np.zeros((number, 4)),
        np.array(NUMBERS), np.array(SHOT), ("followed",) * number, 0,
    )  # fmt: skip
    fit = Fit(frames, np.zeros((number, 3, 2)), np.zeros((number, 1), int), np.ones((number, 3)), state)
    clip = Clip(Path("clip.mp4"), "", (8, 8), 1001 * np.arange(100), Fraction(1, 24000))
    return np.array(NUMBERS), crops, fit, clip


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_rows_say_what_is_shown_and_how_long(tmp_path: Path) -> None:
    numbers, crops, fit, clip = values()
    write_exposure(tmp_path / "exposure.csv", numbers, crops, fit, clip)
    sheet = rows(tmp_path / "exposure.csv")
    assert [int(row["frame"]) for row in sheet] == fit.frames.tolist()
    assert [row["drawing"] for row in sheet] == [*"122333", "2", "2", "", "2", *"4444"]
    assert [row["frames_held"] for row in sheet] == [*"122333", "2", "2", "", "1", *"4444"]
    assert [row["is_reused"] == "true" for row in sheet] == [index in (6, 7, 9) for index in range(len(NUMBERS))]
    first = [0, 1, 1, 3, 3, 3, 6, 6, None, 9, 10, 10, 10, 10]
    assert [row["first_frame"] for row in sheet] == ["" if index is None else str(FIRST + index) for index in first]
    assert [int(row["shot"]) for row in sheet] == [shot + 1 for shot in SHOT]
    assert [row["state"] for row in sheet] == list(fit.state)
    assert [Fraction(row["seconds_exact"]) for row in sheet] == [Fraction(1001 * int(t), 24000) for t in fit.frames]
    assert sheet[0]["seconds"] == "1.251250000"
    assert sheet[1]["seconds"] == "1.292958333"


def test_drawings_have_no_times(tmp_path: Path) -> None:
    numbers, crops, fit, _ = values()
    write_exposure(tmp_path / "exposure.csv", numbers, crops, fit)
    assert {(row["seconds"], row["seconds_exact"]) for row in rows(tmp_path / "exposure.csv")} == {("", "")}


def test_summary_counts_frames_not_exposures() -> None:
    numbers, crops, fit, _ = values()
    assert summary_of(exposures_of(numbers, crops, fit)) == {
        "drawings": 4, "exposures": 6, "reused": 2,
        "ones": round(2 / 13, 4), "twos": round(4 / 13, 4), "threes": round(3 / 13, 4), "longer": round(4 / 13, 4),
    }  # fmt: skip
