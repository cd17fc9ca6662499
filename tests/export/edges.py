"""Outlines of the drawn rectangles: how far points are from where the ink ends."""

import numpy as np

from tests.correspond import scene
from wildpuppet.geometry.affine import apply, invert

CORNER = 0.36
"""Canvas pixels: a traced edge cuts the corner of a pixel, half a pixel from it on each side."""
PIXELS = 2e-3


def assert_runs_around_the_ink(world, t, layer, points):
    """Brought back to the canvas, the points lie on the rectangle's border and reach all of it."""
    x, y, width, height = (scene.BODY, scene.ARM)[layer]
    canvas = apply(invert(world.maps[t, layer]), np.asarray(points, float))
    off = np.stack([canvas[:, 0] - x, x + width - canvas[:, 0], canvas[:, 1] - y, y + height - canvas[:, 1]])
    assert np.abs(off).min(0).max() < CORNER
    assert np.abs(canvas.min(0) - (x, y)).max() < PIXELS
    assert np.abs(canvas.max(0) - (x + width, y + height)).max() < PIXELS
