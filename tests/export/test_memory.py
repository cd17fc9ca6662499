"""Frames are streamed: a longer export takes no more memory than its meshes."""

import tracemalloc

import pytest

from tests.export.moving import moving
from wildpuppet.export.export import export
from wildpuppet.export.formats import FORMATS

FRAME_BYTES = 160 * 120 * 4
SHORT, LONG = 8, 24


@pytest.mark.parametrize("each", [each for each in FORMATS if each.holds == "pictures"], ids=lambda each: each.name)
def test_pictures_are_not_kept(tmp_path, each):
    export(moving(2).animation, each, tmp_path / "warm")  # imports and compiles
    short, long = (peak_bytes(moving(count).animation, each, tmp_path / str(count)) for count in (SHORT, LONG))
    assert long - short < 0.25 * (LONG - SHORT) * FRAME_BYTES


def peak_bytes(animation, each, out):
    _ = animation.pose, animation.is_visible
    tracemalloc.start()
    try:
        export(animation, each, out)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
