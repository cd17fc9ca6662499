import numpy as np

from wildpuppet.track.plate import median_plate
from wildpuppet.track.plate_kernel import masked_median


def test_the_masked_median_is_numpys_lower_median_of_what_is_seen():
    draw = np.random.default_rng(1)
    stack = draw.integers(0, 256, (9, 5, 6, 3), dtype=np.uint8)
    seen = (draw.random((9, 5, 6)) > 0.4).astype(np.uint8) * 255
    seen[:, 0, 0] = 0
    median, spread, count = masked_median(stack, seen)
    assert (median[0, 0] == 0).all()
    assert (spread[0, 0], count[0, 0]) == (255, 0)
    for y, x in np.argwhere(seen.any(0)):
        values = stack[seen[:, y, x] > 0, y, x].astype(int)
        middle = np.sort(values, 0)[(len(values) - 1) // 2]
        deviation = np.sort(np.abs(values - middle).max(1))[(len(values) - 1) // 2]
        assert (median[y, x] == middle).all()
        assert (spread[y, x], count[y, x]) == (deviation, len(values))


def test_a_panned_world_is_put_together_and_what_is_covered_stays_unknown():
    draw = np.random.default_rng(2)
    world = draw.integers(30, 220, (40, 80, 3), dtype=np.uint8)
    shifts = np.arange(0, 33, 4)
    noisy = [np.clip(world[:, s : s + 48] + draw.normal(0, 2, (40, 48, 3)), 0, 255).astype(np.uint8) for s in shifts]
    visible = [np.full((40, 48), 255, np.uint8) for _ in shifts]
    for picture, mask, shift in zip(noisy, visible, shifts, strict=True):
        left = 38 - shift  # a post that stands in the world, and is marked as the character
        picture[10:30, left : left + 4] = 255
        mask[8:32, left - 2 : left + 6] = 0
    maps = np.stack([[[1.0, 0.0, s], [0.0, 1.0, 0.0]] for s in shifts])
    plate = median_plate(noisy, visible, maps)
    assert plate.colour.shape == (40, 80, 3)
    often = plate.count >= 5
    difference = plate.colour.astype(int) - world
    assert np.abs(difference[often]).mean() < 1.5  # deviation 2 of single pictures, the median of five and more
    assert (plate.count[10:30, 38:42] == 0).all()
    assert (plate.spread[10:30, 38:42] == 255).all()
