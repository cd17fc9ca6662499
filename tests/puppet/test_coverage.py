import numpy as np
import pytest
from skimage.measure import points_in_poly

from wildpuppet.puppet.coverage import rings_coverage

SQUARE = np.array([(10.0, 10.0), (30.0, 10.0), (30.0, 30.0), (10.0, 30.0)])


@pytest.mark.parametrize(
    ("rings", "rule", "area"),
    [
        ([SQUARE, SQUARE + 10.0], "evenodd", 600.0),
        ([SQUARE, SQUARE + 10.0], "nonzero", 700.0),
        ([SQUARE, SQUARE[::-1] + 10.0], "nonzero", 600.0),
        ([SQUARE, SQUARE + 10.0, SQUARE + 5.0], "nonzero", 750.0),
        ([SQUARE, SQUARE * 0.5 + 10.0], "evenodd", 400.0 - 100.0),
        ([SQUARE, SQUARE + 1000.0], "nonzero", 400.0),
        ([SQUARE - 100.0], "nonzero", 0.0),
        ([SQUARE - 20.0], "evenodd", 100.0),
    ],
)
def test_rings_add_up_by_their_rule(rings: list[np.ndarray], rule: str, area: float) -> None:
    assert rings_coverage(rings, (50, 50), rule).sum() == pytest.approx(area)  # type: ignore[arg-type]


def test_crossing_random_rings_agree_with_samples() -> None:
    """Even-odd: what lies inside an odd number of rings, by scikit-image at 16 x 16 samples a pixel."""
    generator = np.random.default_rng(0)
    rings = [generator.uniform(-10, 70, (9, 2)) for _ in range(3)]
    y, x = (np.indices((960, 960)).reshape(2, -1) + 0.5) / 16
    odd = np.logical_xor.reduce([points_in_poly(np.stack([x, y], axis=1), ring) for ring in rings])
    expected = odd.reshape(60, 16, 60, 16).mean((1, 3))
    difference = np.abs(rings_coverage(rings, (60, 60)) - expected)
    assert difference.max() < 0.15  # eight scan lines against sixteen rows of samples
    assert difference.mean() < 0.005


def test_a_ring_of_many_points_is_taken_in_bands() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 20_000, endpoint=False)
    circle = 40.0 + 30.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert rings_coverage([circle], (80, 80)).sum() == pytest.approx(np.pi * 900.0, rel=1e-3)
