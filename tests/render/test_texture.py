"""Texture levels: exact areas, and alpha that never touches a mesh's border."""

import cv2
import numpy as np
import pytest
import torch

from wildpuppet.render.render import mesh_of, render
from wildpuppet.render.texture import inside_by_a_texel, resample, texture_at
from wildpuppet.types import Puppet


def disc_puppet() -> Puppet:
    """Return a disc of radius 30 drawn by OpenCV in a polygon of radius 38 with a second, square part beside it."""
    atlas = np.zeros((90, 170, 4), np.uint8)
    atlas[..., :3] = (200, 100, 50)
    alpha = np.zeros((90, 170), np.uint8)
    cv2.circle(alpha, (44, 44), 30, 255, -1, cv2.LINE_AA)
    cv2.rectangle(alpha, (100, 20), (150, 70), 255, -1)
    atlas[..., 3] = alpha
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    rim = 44.5 + 38 * np.stack([np.cos(angles), np.sin(angles)], 1)
    corners = np.array([[94, 14], [157, 14], [157, 77], [94, 77.0]])
    vertices = np.concatenate([[[44.5, 44.5]], rim, corners])
    fan = np.stack([np.zeros(16, int), 1 + np.arange(16), 1 + (np.arange(16) + 1) % 16], 1)
    triangles = np.concatenate([fan, [[17, 18, 19], [17, 19, 20]]])
    none = np.zeros((0, 2, 3))
    return Puppet(
        ("disc", "square"), (170, 90), vertices, triangles, np.repeat([0, 1], [17, 4]), vertices.copy(), atlas,
        np.zeros((0, 2), int), none.astype(int), none,
    )  # fmt: skip


@pytest.mark.parametrize("scale", [0.5, 0.25, 1.0])
def test_resampling_averages_areas(scale: float) -> None:
    image = np.random.default_rng(0).random((32, 40, 4)).astype(np.float32)
    size = (int(40 * scale), int(32 * scale))
    np.testing.assert_allclose(resample(image, scale), cv2.resize(image, size, interpolation=cv2.INTER_AREA), atol=1e-5)


def test_resampling_keeps_the_sum_at_odd_scales() -> None:
    image = np.random.default_rng(0).random((31, 17, 4)).astype(np.float32)
    for scale in (0.37, 0.81, 0.013):
        np.testing.assert_allclose(resample(image, scale).sum((0, 1)), image.sum((0, 1)) * scale**2, rtol=1e-4)


@pytest.mark.parametrize("scale", [1.0, 0.6, 0.3, 0.11])
def test_alpha_is_zero_wherever_a_sample_on_the_border_reaches(scale: float) -> None:
    puppet = disc_puppet()
    texture = texture_at(puppet, scale)
    opaque = Puppet(**{**puppet.__dict__, "atlas": np.full_like(puppet.atlas, 255)})
    level = texture_at(opaque, scale).rgba[..., 3].numpy()
    steps = np.linspace(0, 1, 200)[:, None]
    outline = [np.append(np.arange(1, 17), 1), np.append(np.arange(17, 21), 17)]
    for ring in outline:
        for a, b in zip(texture.uv.numpy()[ring[:-1]], texture.uv.numpy()[ring[1:]], strict=True):
            points = np.clip((1 - steps) * a + steps * b, 0.5, None).astype(np.float32) - 0.5
            padded = np.pad(level, 2)
            on_border = cv2.remap(padded, points[None, :, 0] + 2, points[None, :, 1] + 2, cv2.INTER_LINEAR)
            assert on_border.max() == 0
    assert texture.rgba[..., 3].max() > 0.99 or scale < 0.2


def test_texels_deep_inside_are_kept_and_outside_ones_are_not() -> None:
    puppet = disc_puppet()
    inside = inside_by_a_texel(puppet.uv, puppet.triangles, (90, 170))
    y, x = np.mgrid[:90, :170] + 0.5
    radius = np.hypot(x - 44.5, y - 44.5)
    assert inside[radius < 38 * np.cos(np.pi / 16) - 1.5].all()
    assert not inside[(radius > 38) & (x < 90)].any()
    square = (np.abs(x - 125.5) <= 30.5) & (np.abs(y - 45.5) <= 30.5)
    assert (inside[:, 90:] == square[:, 90:]).all()


def test_drawing_a_level_matches_opencv_shrinking_the_picture() -> None:
    puppet = disc_puppet()
    texture, mesh = texture_at(puppet, 0.5), mesh_of(puppet)
    vertices = torch.tensor(puppet.vertices * 0.5, dtype=torch.float32)[None]
    drawn = render(vertices, mesh, texture, torch.tensor([[0, 1]]), (85, 45)).rgba[0].numpy()
    straight = puppet.atlas.astype(np.float32) / 255
    straight[..., :3] *= straight[..., 3:]
    np.testing.assert_allclose(drawn, cv2.resize(straight, (85, 45), interpolation=cv2.INTER_AREA), atol=1e-4)


@pytest.mark.parametrize("scale", [0.5, 0.3, 0.15])
def test_coarse_levels_keep_a_parts_width(scale: float) -> None:
    """At 0.15 a screen pixel is wider than the margin; the disc must not shrink by it, wherever it falls on pixels."""
    puppet = disc_puppet()
    texture, mesh = texture_at(puppet, scale), mesh_of(puppet)
    shifts = torch.rand(16, 1, 2, generator=torch.Generator().manual_seed(0)) + 2
    vertices = torch.tensor(puppet.vertices * scale, dtype=torch.float32) + shifts
    drawn = render(vertices, mesh, texture, torch.tensor([[0, 1]]).expand(16, 2), (90, 50)).rgba[..., 3].sum((1, 2))
    area = puppet.atlas[..., 3].sum() / 255.0 * scale**2
    assert abs(float(drawn.mean()) / area - 1.0) < 0.03


def test_scale_must_be_positive() -> None:
    with pytest.raises(ValueError, match="positive"):
        texture_at(disc_puppet(), 0.0)
