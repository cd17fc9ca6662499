import cv2
import numpy as np
import pytest

from tests.track.drawn import SIZE, painted_figure, painted_world, placed, view
from wildpuppet.geometry import affine
from wildpuppet.track.camera import Camera

# LK finds a feature to about a tenth of a pixel on these pictures; a common motion of a hundred of them is better.
PIXELS = 0.25


def picture(corner: np.ndarray, zoom: float, centre: np.ndarray) -> np.ndarray:
    """Gray view of the world with a figure that covers features and moves otherwise than the camera."""
    figure = placed(painted_figure(), centre, 1.6)
    cover = figure[..., 3:] / 255.0
    shown = np.clip(view(painted_world(4), corner, zoom) * (1 - cover) + figure[..., :3], 0, 255).astype(np.uint8)
    return cv2.cvtColor(shown, cv2.COLOR_RGB2GRAY)


@pytest.mark.parametrize("kind", ["still", "pan", "zoom"])
def test_the_planes_map_is_the_cameras_within_a_fraction_of_a_pixel(kind):
    count = 24
    share = np.linspace(0, 1, count)
    corner = np.array([200.0, 120.0]) + share[:, None] * np.array([260.0, 30.0]) * (kind == "pan")
    zoom = 1.0 + 0.5 * share * (kind == "zoom")
    centre = np.stack([160 + 60 * np.sin(9 * share), 100 + 0 * share], 1)
    camera = Camera()
    found = [camera.step(picture(corner[t], zoom[t], centre[t]), None) for t in range(count)]
    corners = np.array([[0.0, 0.0], [SIZE[0], 0.0], [0.0, SIZE[1]], [SIZE[0], SIZE[1]]])
    for t in range(count):
        true = affine.scale_and_shift(zoom[0] / zoom[t], tuple((corner[t] - corner[0]) * zoom[0]))
        error = np.abs(affine.apply(found[t], corners) - affine.apply(true, corners)).max()
        assert error < (0.0 if kind == "still" else PIXELS) + 1e-12, t


def test_a_blank_picture_leaves_the_camera_where_it_was():
    camera = Camera()
    blank = np.full((120, 160), 90, np.uint8)
    assert all(np.array_equal(camera.step(blank, None), [[1, 0, 0], [0, 1, 0]]) for _ in range(3))
