from fractions import Fraction

import numpy as np
import pytest

from wildpuppet.export.timing import timing_of

FILM = Fraction(24000, 1001)


@pytest.mark.parametrize(
    ("pts", "base", "rate"),
    [
        (np.arange(9) * 1001 + 77, Fraction(1, 24000), FILM),
        (np.round(np.arange(50) * 1000 / float(FILM)).astype(int), Fraction(1, 1000), FILM),
        (np.round(np.arange(500) * 1000 / 24).astype(int), Fraction(1, 1000), Fraction(24)),
        (np.arange(5) * 512, Fraction(1, 12288), Fraction(24)),
        (np.arange(5) * 3, Fraction(1, 100), Fraction(100, 3)),
    ],
)
def test_even_times_have_an_exact_rate(pts, base, rate):
    timing = timing_of(len(pts), (pts, base))
    assert (timing.rate, timing.is_variable) == (rate, False)
    last = len(pts) - 1
    assert timing.seconds(last) == last / rate
    assert abs(timing.clip_seconds(last) - timing.seconds(last)) <= base
    assert timing.end_seconds() == len(pts) / rate


def test_uneven_times_are_exact_and_said_to_be_variable():
    timing = timing_of(6, (np.array([0, 33, 67, 150, 192, 233]), Fraction(1, 1000)))
    assert timing.is_variable
    assert timing.rate == 24
    assert timing.seconds(3) == Fraction(150, 1000)


def test_drawings_and_single_frames_have_a_rate():
    assert timing_of(3, None).seconds(2) == Fraction(1, 2)
    assert timing_of(1, (np.array([5]), Fraction(1, 25))).seconds(0) == 0
