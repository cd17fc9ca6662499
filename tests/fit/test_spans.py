import numpy as np
import pytest

from wildpuppet.fit.spans import spans_of

DRAWINGS = {
    "each new": np.arange(11),
    "twos": np.arange(12) // 2,
    "one long hold": np.array([0, 1, 1, 1, 1, 1, 1, 1, 2, 3, 4]),
    "one drawing": np.zeros(7, int),
    "a drawing comes back": np.array([0, 0, 1, 1, 0, 0, 1, 1, 1, 0]),
    "one frame": np.array([5]),
}


@pytest.mark.parametrize("size", [1, 3, 4, 100])
@pytest.mark.parametrize("name", DRAWINGS)
def test_spans_cover_all_frames_once_and_split_no_hold(name, size):
    drawing = DRAWINGS[name]
    spans = spans_of(drawing, size)
    assert [i for span in spans for i in range(*span.indices(len(drawing)))] == list(range(len(drawing)))
    for span in spans[1:]:
        assert drawing[span.start] != drawing[span.start - 1]
    for span in spans[:-1]:  # no longer than the hold that it ends in asks for
        short = drawing[span.start : span.start + size]
        assert size <= span.stop - span.start < size + np.bincount(drawing)[short[-1]]
