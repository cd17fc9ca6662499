"""Frames are streamed: a longer clip takes no more memory."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.cli import run_command
from tests.pipelines.drawn import FRAMES, Drawn, drawn_in, scene
from tests.scenes import write_clip
from wildpuppet.track import working

SHORT, LONG = 56, 112
"""Frames. The background is learnt from up to 60 frames, evenly spread: here from 56 of both clips."""
FRAME_BYTES = scene().frames[0].nbytes


def test_long_clip_takes_no_more_memory_than_a_short_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(working, "KEPT_BYTES", 0)  # the tracker's own bounded share
    assert clip_of(8, tmp_path / "warm").run("--until", "crop", "--crop.matte=True") == 0  # imports and compiles
    short, long = (peak_bytes(clip_of(count, tmp_path / str(count))) for count in (SHORT, LONG))
    assert long - short < 0.25 * (LONG - SHORT) * FRAME_BYTES


def clip_of(count: int, folder: Path) -> Drawn:
    """Draw a clip that goes back and forth."""
    folder.mkdir()
    drawn = drawn_in(folder)
    there_and_back = np.r_[0:FRAMES, FRAMES - 1 : -1 : -1]
    write_clip(replace(scene(), frames=scene().frames[np.resize(there_and_back, count)]), drawn.video)
    return drawn


def peak_bytes(drawn: Drawn) -> int:
    """The most memory that a run to its crops holds at once; numpy's and OpenCV's arrays count."""
    words = [*drawn.arguments(), "--until", "crop", "--crop.matte=True"]
    tracemalloc.start()
    try:
        assert run_command(words) == 0
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
