import numpy as np
import pytest

from wildpuppet.puppet.complete import bleed_colour, complete_colour, grow

RED, BLUE = (220, 30, 30), (40, 60, 200)


def test_a_linear_gradient_closes_over_a_hole() -> None:
    ramp = np.linspace(10, 240, 40)
    image = np.rint(np.broadcast_to(ramp[:, None, None], (40, 30, 3))).astype(np.uint8)
    image = image.copy()
    hole = np.zeros((40, 30), bool)
    hole[12:28, :] = True
    truth = image.copy()
    image[hole] = 255
    completed = complete_colour(image, 1.0 - hole, np.ones((40, 30), bool))
    # Laplace's equation between two straight edges is linear; 1 for rounding.
    assert np.abs(completed.astype(int) - truth).max() <= 1


def test_colour_does_not_cross_a_gap_in_the_part() -> None:
    image = np.zeros((20, 41, 3), np.uint8)
    image[:, :20], image[:, 21:] = RED, BLUE
    is_wanted = np.ones((20, 41), bool)
    is_wanted[:, 20] = False
    trust = is_wanted.astype(float)
    trust[5:, 10:31] = 0
    image[5:, 10:31] = 255
    completed = complete_colour(image, trust, is_wanted)
    assert (completed[:, :20] == RED).all()
    assert (completed[:, 21:] == BLUE).all()


def test_trusted_and_unwanted_pixels_are_kept() -> None:
    image = np.random.default_rng(0).integers(0, 256, (30, 30, 3)).astype(np.uint8)
    trust = np.zeros((30, 30))
    trust[:, :10] = 1
    is_wanted = np.zeros((30, 30), bool)
    is_wanted[:, :20] = True
    completed = complete_colour(image, trust, is_wanted, inset=2)
    assert np.array_equal(completed[:, :10], image[:, :10])
    assert np.array_equal(completed[:, 20:], image[:, 20:])
    assert (completed[:, 10:20] != image[:, 10:20]).any()


def test_half_trust_mixes_half() -> None:
    image = np.full((9, 9, 3), 100, np.uint8)
    image[4, 4] = 200
    trust = np.ones((9, 9))
    trust[4, 4] = 0.5
    assert (complete_colour(image, trust, np.ones((9, 9), bool))[4, 4] == 150).all()


def test_polluted_edges_lend_no_colour_with_an_inset() -> None:
    image = np.full((30, 30, 3), BLUE, np.uint8)
    image[:, 14:16] = RED
    trust = np.ones((30, 30))
    trust[:, 16:] = 0
    completed = complete_colour(image, trust, np.ones((30, 30), bool), inset=3)
    assert (completed[:, 16:] == BLUE).all()
    assert (completed[:, 14:16] == RED).all()


def test_a_piece_that_touches_no_source_takes_the_nearest_colour() -> None:
    image = np.full((10, 21, 3), 255, np.uint8)
    image[:, :10] = RED
    is_wanted = np.ones((10, 21), bool)
    is_wanted[:, 10] = False
    trust = np.zeros((10, 21))
    trust[:, :10] = 1
    assert (complete_colour(image, trust, is_wanted)[:, 11:] == RED).all()


def test_nothing_trusted_is_a_programming_mistake() -> None:
    with pytest.raises(ValueError, match="trusted"):
        complete_colour(np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.ones((4, 4), bool))


def test_bleed_takes_the_nearest_inside_colour() -> None:
    image = np.zeros((9, 9, 3), np.uint8)
    image[4, 3], image[4, 5] = RED, BLUE
    bled = bleed_colour(image, image.any(-1), 2)
    assert tuple(bled[4, 1]) == RED
    assert tuple(bled[4, 7]) == BLUE
    assert not bled[4, 0].any()


def test_growing_adds_a_disc() -> None:
    mask = np.zeros((9, 9), bool)
    mask[4, 4] = True
    assert grow(mask, 0).sum() == 1
    grown = grow(mask, 2)
    assert grown[4, 2]
    assert grown[2, 4]
    assert not grown[2, 2]
