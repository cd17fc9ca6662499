from dataclasses import replace

import numpy as np
import pytest

from tests.scene_values import crops_of
from tests.scenes import make_scene
from wildpuppet.fit.better import TRUST, better
from wildpuppet.fit.descent import LOSS_NAMES
from wildpuppet.fit.solve import total
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Fit

SETTINGS = FitSettings(reconstruction=2.0, arap=3.0, joints=5.0, area=7.0)
DRAWING = np.array([0, 0, 1, 2, 2, 2])
FRAMES = len(DRAWING)


@pytest.fixture(scope="module")
def crops() -> Crops:
    scene = make_scene("walk", frames=FRAMES, size=(64, 48))
    return replace(crops_of(scene), drawing=DRAWING)


def fit_with(energy: list[float], place: float) -> Fit:
    """All vertices at ``place``; the whole energy is reconstruction, in its weight."""
    losses = {name: np.zeros(FRAMES) for name in LOSS_NAMES}
    losses["reconstruction"] = np.array(energy) / SETTINGS.reconstruction
    shape = (FRAMES, 4)
    return Fit(
        np.arange(FRAMES), np.full((*shape, 2), place, np.float32), np.tile(np.arange(2), (FRAMES, 1)),
        np.full(shape, place / 10, np.float32), ("fitted",) * FRAMES, losses,
    )  # fmt: skip


def test_energy_weighs_every_term():
    losses = {name: np.full(FRAMES, 10.0**place) for place, name in enumerate(LOSS_NAMES)}
    assert LOSS_NAMES == ("reconstruction", "coverage", "arap", "joints", "area")
    np.testing.assert_allclose(total(losses, SETTINGS), 2 + 20 + 300 + 5000 + 70000)


def test_a_drawing_takes_the_second_fit_unless_its_energy_is_much_higher(crops):
    first = fit_with([10, 10, 10, 10, 10, 10], 1.0)
    second = fit_with([10, 10.5, 10 * TRUST + 0.1, 5, 15, 11], 2.0)
    found = better(crops, first, second, SETTINGS)
    chosen = np.array([2, 2, 1, 2, 2, 2])  # of a held drawing all frames count together
    np.testing.assert_array_equal(found.vertices_crop[:, 0, 0], chosen)
    np.testing.assert_allclose(found.confidence[:, 0], chosen / 10)
    np.testing.assert_allclose(total(found.losses, SETTINGS), [10, 10.5, 10, 5, 15, 11])
    np.testing.assert_array_equal(found.frames, first.frames)
