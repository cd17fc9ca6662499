import numpy as np

from wildpuppet.fit.advice import worth_a_look
from wildpuppet.types import Fit, FitState


def fit_with(confidence: list[float], state: dict[int, FitState]) -> Fit:
    number = len(confidence)
    states: list[FitState] = [state.get(index, "fitted") for index in range(number)]
    vertices, order = np.zeros((number, 2, 2)), np.zeros((number, 1), int)
    return Fit(100 + np.arange(number), vertices, order, np.repeat(np.array(confidence)[:, None], 2, 1), tuple(states))


def test_the_least_trusted_come_first_and_apart_and_lost_ones_before_them() -> None:
    confidence = [0.9] * 30
    confidence[10], confidence[11], confidence[20], confidence[21], confidence[5] = 0.2, 0.1, 0.05, 0.3, 0.15
    fit = fit_with(confidence, {20: "held", 28: "lost", 29: "lost"})
    assert worth_a_look(fit, 4) == [128, 111, 105, 121]


def test_short_fits_name_what_they_have() -> None:
    assert worth_a_look(fit_with([0.5, 0.4], {})) == [101]
    assert worth_a_look(fit_with([0.5] * 9, {})) == [100, 104, 108]
