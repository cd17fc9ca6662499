import numpy as np
import pytest

from wildpuppet.export.stacking import sheets


def assert_shows(stack, order):
    everywhere = np.ones(len(order), bool)
    shown = np.stack([sheet.shown(everywhere) for sheet in stack])
    for t, wanted in enumerate(order):
        assert [stack[k].layer for k in np.flatnonzero(shown[:, t])] == wanted.tolist()


@pytest.mark.parametrize("num_layers", [1, 2, 5, 9])
def test_the_sheets_shown_are_always_the_order(num_layers):
    rng = np.random.default_rng(num_layers)
    for _ in range(30):
        order = np.stack([rng.permutation(num_layers) for _ in range(12)])
        order = order[np.sort(rng.integers(0, 12, 20))]  # some are held
        assert_shows(sheets(order), order)


@pytest.mark.parametrize(
    ("orders", "layers"),
    [
        ([[0, 1, 2]] * 3, [0, 1, 2]),
        ([[0, 1, 2], [1, 0, 2], [0, 1, 2], [1, 0, 2]], [1, 0, 1, 2]),  # back and forth takes one sheet more
        ([[0, 1, 2, 3], [3, 0, 1, 2]], [3, 0, 1, 2, 3]),  # the one that moves moves
    ],
)
def test_few_sheets_are_enough(orders, layers):
    order = np.array(orders)
    stack = sheets(order)
    assert_shows(stack, order)
    assert len(stack) == len(layers)


def test_lost_frames_show_nothing():
    is_visible = np.array([True, False, True])
    (only,) = sheets(np.zeros((3, 1), int))
    assert only.shown(is_visible).tolist() == [True, False, True]
