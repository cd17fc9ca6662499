from itertools import pairwise

import numpy as np
import pytest

from wildpuppet.fit.spans import spans_of


@pytest.mark.parametrize("size", [1, 3, 16, 100])
def test_spans_cover_all_frames_and_split_no_drawing(size: int) -> None:
    drawing = np.repeat(np.arange(30), np.random.default_rng(size).integers(1, 6, 30))
    spans = spans_of(drawing, size)
    assert [index for span in spans for index in range(span.start, span.stop)] == list(range(len(drawing)))
    assert all(drawing[before.stop - 1] != drawing[after.start] for before, after in pairwise(spans))
    assert all(size <= span.stop - span.start < size + 5 for span in spans[:-1])


def test_frames_of_one_drawing_are_one_span() -> None:
    assert spans_of(np.zeros(40, int), 16) == [slice(0, 40)]
