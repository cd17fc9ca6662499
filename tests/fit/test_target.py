import numpy as np
import pytest
import torch
from skimage.color import rgb2lab

from tests.pose.boxes import COLOURS, box_puppet
from wildpuppet.fit.target import target_at, texture_for
from wildpuppet.render.render import mesh_of, render

torch.set_num_threads(1)
WORTH = 800.0
STRETCH = 2.55
"""Grey levels per unit of CIE lightness."""


def test_colours_are_lab_with_lightness_0_to_255():
    images = np.random.default_rng(0).integers(0, 256, (2, 6, 8, 4), np.uint8)
    images[0, 0, 0, :3], images[0, 0, 1, :3] = 255, 0
    target = target_at(images, 1.0, WORTH)
    np.testing.assert_allclose(target.colour, STRETCH * rgb2lab(images[..., :3]), atol=1.0)
    np.testing.assert_allclose(target.colour[0, 0, :2], [[255, 0, 0], [0, 0, 0]], atol=0.1)


@pytest.mark.parametrize(("matte", "gain"), [(255, WORTH), (0, -WORTH), (128, WORTH / 2)])
def test_covering_is_worth_what_the_matte_says(matte, gain):
    images = np.full((1, 6, 8, 4), matte, np.uint8)
    assert target_at(images, 1.0, WORTH).cover_gain.numpy() == pytest.approx(gain, rel=0.02)
    assert (target_at(images, 1.0, 0.0).cover_gain == 0).all()


def test_covering_is_worth_more_the_surer_the_matte():
    images = np.zeros((1, 1, 256, 4), np.uint8)
    images[0, 0, :, 3] = np.arange(256)
    assert (np.diff(target_at(images, 1.0, WORTH).cover_gain[0, 0]) >= 0).all()


def test_levels_average_pixels():
    images = np.zeros((1, 40, 60, 4), np.uint8)
    images[:, 10:20, 30:40] = (255, 255, 255, 255)
    target = target_at(images, 0.1, WORTH)
    assert target.level == 0.1
    assert target.colour.shape == (1, 4, 6, 3)
    lightness = np.zeros((4, 6))
    lightness[1, 3] = 255
    np.testing.assert_allclose(target.colour[0, ..., 0], lightness, atol=0.1)
    np.testing.assert_allclose(target.cover_gain[0], np.where(lightness > 0, WORTH, -WORTH))


@pytest.mark.parametrize("scale", [1.0, 2.0, 0.5])
def test_texture_is_in_the_targets_colours(scale):
    puppet = box_puppet([(8, 8, 20, 16), (34, 10, 16, 24)])
    vertices = torch.from_numpy(scale * puppet.vertices).float()[None]
    size = (int(64 * scale), int(48 * scale))
    image = render(vertices, mesh_of(puppet), texture_for(puppet, scale), torch.tensor([[0, 1]]), size).rgba[0]
    for (x, y), colour in zip(((18, 16), (42, 22)), COLOURS, strict=False):
        pixel = image[int(y * scale), int(x * scale)]
        assert pixel[3] == pytest.approx(1.0, abs=0.01)
        flat = STRETCH * rgb2lab(np.array([[colour]], np.uint8))[0, 0]
        np.testing.assert_allclose(255 * pixel[:3], flat, atol=2.0)
