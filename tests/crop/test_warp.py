import numpy as np
import pytest

from wildpuppet.crop.warp import cut_window, inside_image
from wildpuppet.geometry import affine

# OpenCV's linear warp places samples on a grid of 1/32 pixel.
GRID = 1 / 32


def ramp(width: int, height: int) -> np.ndarray:
    """Each pixel's value is twice its centre's x, and its centre's y."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([2 * x, y, 0 * x], -1)


@pytest.mark.parametrize(
    ("scale", "shift"), [(1.0, (10.0, 7.0)), (1.0, (10.25, 7.5)), (0.5, (20.0, 10.0)), (2.0, (8.0, 4.0))]
)
def test_a_crop_shows_the_place_that_its_map_says(scale, shift):
    image = ramp(120, 90)
    image_from_crop = affine.scale_and_shift(scale, shift)
    crop = cut_window(np.round(image).astype(np.uint8), image_from_crop, (30, 24)).astype(float)
    wanted = affine.apply(
        image_from_crop, np.stack(np.meshgrid(np.arange(30) + 0.5, np.arange(24) + 0.5), -1).reshape(-1, 2)
    )
    error = crop[..., :2].reshape(-1, 2) - wanted * [2.0, 1.0]
    assert np.abs(error.mean(0)).max() < 0.5 + 2 * GRID  # rounding to whole values, then no shift is left
    assert np.abs(error).max() < 1.0 + 2 * GRID


def test_whole_pixels_are_copied_exactly():
    image = np.random.default_rng(0).integers(0, 256, (50, 60, 3), dtype=np.uint8)
    crop = cut_window(image, affine.scale_and_shift(1.0, (12.0, 9.0)), (20, 16))
    assert np.array_equal(crop, image[9:25, 12:32])


def test_beyond_the_image_its_edge_is_repeated():
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    crop = cut_window(image, affine.scale_and_shift(1.0, (-5.0, 10.0)), (12, 14))
    assert (crop[:10, :5] == image[10:20, :1]).all()
    assert (crop[10:, 5:] == image[19:20, :7]).all()
    beyond = cut_window(image, affine.scale_and_shift(1.0, (-100.0, 3.0)), (8, 8))
    assert (beyond == image[3:11, :1]).all()


def test_a_fine_grating_shrinks_to_gray_instead_of_aliasing():
    image = np.zeros((80, 80, 3), np.uint8)
    image[:, ::2] = 255
    crop = cut_window(image, affine.scale_and_shift(2.7, (0.0, 0.0)), (28, 28))
    assert crop[4:-4, 4:-4].std() < 12


def test_what_lies_inside_is_marked_by_pixel_centres():
    inside = inside_image((10, 8), affine.scale_and_shift(1.0, (-2.5, 7.0)), (14, 3))
    assert np.array_equal(inside[0], (np.arange(14) >= 2) & (np.arange(14) < 12))
    assert not inside[1:].any()
    with pytest.raises(ValueError, match="turn"):
        inside_image((10, 8), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), (4, 4))
