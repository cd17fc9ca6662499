import numpy as np
import pytest

from tests.track.drawn import SIZE, painted_world, view
from wildpuppet.track.growth import growth_between, median_growth


def test_a_limb_that_swings_does_not_pass_for_growth():
    grid = np.stack(np.meshgrid(np.arange(0, 60, 10.0), np.arange(0, 80, 10.0)), -1).reshape(-1, 2).astype(np.float32)
    grown = 1.02 * grid + 3.0
    grown[:10] += np.random.default_rng(0).normal(0, 8, (10, 2))  # one point in five moves on its own
    assert abs(median_growth(grid, grown.astype(np.float32), 10.0) - 1.02) < 1e-3


@pytest.mark.parametrize("zoom", [0.97, 1.0, 1.03])
def test_growth_is_measured_in_pictures(zoom):
    world = painted_world(3)
    first, second = (view(world, np.array([300.0, 150.0]), z).astype(np.uint8)[..., 1].copy() for z in (1.0, zoom))
    assert abs(growth_between(first, second, (20.0, 20.0, 200.0, 120.0)) - zoom) < 2e-3


def test_nothing_to_follow_is_no_growth():
    blank = np.full((SIZE[1], SIZE[0]), 80, np.uint8)
    assert growth_between(blank, blank, (20.0, 20.0, 100.0, 100.0)) == 1.0
    assert growth_between(blank, blank, (-50.0, 20.0, 52.0, 100.0)) == 1.0
