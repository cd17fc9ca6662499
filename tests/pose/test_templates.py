import numpy as np
import pytest
from skimage.color import rgb2lab

from tests.pose.boxes import COLOURS, box_puppet
from wildpuppet.pose.templates import Templates, make_templates, palette_of, part_images
from wildpuppet.puppet.colour import lab

BOXES = [(10, 6, 21, 9), (26, 10, 7, 24)]
PUPPET = box_puppet(BOXES)
IMAGES = part_images(PUPPET)


def template(templates: Templates, layer: int, angle: int) -> dict[tuple[int, int], tuple[int, float]]:
    """Colour and weight at each (dx, dy) from the pivot's pixel."""
    mine = slice(templates.start[layer, angle], templates.start[layer, angle] + templates.count[layer, angle])
    found = zip(templates.pixels[mine].tolist(), templates.weights[mine].tolist(), strict=True)
    return {(dx, dy): (colour, weight) for (dy, dx, colour), weight in found}


def test_pictures_and_pivots_are_where_the_parts_are():
    for image, (x, y, w, h) in zip(IMAGES, BOXES, strict=True):
        np.testing.assert_allclose(image.pivot, [x + w / 2, y + h / 2], atol=1e-3)
        rows, columns = np.nonzero(image.premultiplied[..., 3] > 0.5)
        low = image.corner + np.array([columns.min(), rows.min()])
        high = image.corner + np.array([columns.max() + 1, rows.max() + 1])
        np.testing.assert_allclose(np.concatenate([low, high - low]), [x, y, w, h])


def test_colours_are_cie_lab():
    rgb = np.random.default_rng(0).uniform(0, 1, (5, 6, 3)).astype(np.float32)
    np.testing.assert_allclose(lab(rgb), rgb2lab(rgb), atol=0.3)


@pytest.mark.parametrize("most", [4, 20])
def test_palette_finds_flat_colours(most):
    boxes = [(4 + 15 * i, 10, 9, 11) for i in range(4)]
    palette = palette_of(part_images(box_puppet(boxes)), 1.0, most)
    flat = rgb2lab(np.array(COLOURS[:4], np.uint8)[None])[0]
    assert len(palette) == 4
    distance = np.linalg.norm(flat[:, None] - palette[None], axis=-1)
    assert distance.min(1).max() < 0.3
    assert sorted(distance.argmin(1)) == [0, 1, 2, 3]


def test_palette_of_a_single_pixel():
    speck = part_images(box_puppet([(10, 10, 4, 4)]))
    palette = palette_of(speck, 0.1, 4)
    assert palette.shape == (1, 3)
    np.testing.assert_allclose(palette_of(speck, 0.3, 4)[0], rgb2lab(np.array(COLOURS[0], np.uint8)), atol=0.3)


def test_quarter_turns_move_pixels_as_a_turn_does():
    palette = palette_of(IMAGES, 1.0, 4)
    templates = make_templates(IMAGES, 1.0, 4, palette, most_pixels=10**6)
    np.testing.assert_allclose(templates.radians, np.arange(4) * np.pi / 2)
    for layer in range(2):
        rest = template(templates, layer, 0)
        turned = rest
        for angle in range(1, 4):  # x towards y: (x, y) goes to (-y, x)
            turned = {(-dy, dx): value for (dx, dy), value in turned.items()}
            found = template(templates, layer, angle)
            assert found.keys() == turned.keys()
            for place, (colour, weight) in turned.items():
                assert found[place][0] == colour
                assert found[place][1] == pytest.approx(weight, abs=0.05)  # the warp places pixels to 1/32


def test_odd_box_at_rest_is_its_own_pixels():
    palette = palette_of(IMAGES, 1.0, 4)
    rest = template(make_templates(IMAGES, 1.0, 4, palette, most_pixels=10**6), 0, 0)
    assert rest.keys() == {(dx, dy) for dx in range(-10, 11) for dy in range(-4, 5)}
    assert {weight for _, weight in rest.values()} == {1.0}
    (colour,) = {colour for colour, _ in rest.values()}
    np.testing.assert_allclose(palette[colour], rgb2lab(np.array(COLOURS[0], np.uint8)), atol=0.3)


@pytest.mark.parametrize("scale", [0.4, 1.0, 1.7])
@pytest.mark.parametrize("most_pixels", [30, 10**6])
def test_weights_sum_to_the_area(scale, most_pixels):
    templates = make_templates(IMAGES, scale, 12, palette_of(IMAGES, scale, 4), most_pixels)
    for layer, (_, _, w, h) in enumerate(BOXES):
        for angle in range(12):
            mine = template(templates, layer, angle)
            assert len(mine) <= most_pixels
            assert sum(weight for _, weight in mine.values()) == pytest.approx(templates.area[layer], rel=0.1)
            assert np.abs(list(mine)).max() <= templates.reach
        fringe = 0.35 / 2 * 2 * (w + h) * scale  # pixels of less than 0.35 coverage are left out, one along the edge
        assert templates.area[layer] == pytest.approx(w * h * scale**2, abs=fringe)
