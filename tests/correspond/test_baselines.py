import cv2
import numpy as np
import pytest

from wildpuppet.correspond import baselines

FLOW_PIXELS = 0.35
"""DIS finds a textured patch's shift of a few pixels to about a quarter of a pixel."""


def picture(shift):
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (120, 160, 3)).astype(np.float32), (0, 0), 3)
    texture = (texture - texture.min()) * 255 / np.ptp(texture)
    return cv2.warpAffine(texture, np.array([[1.0, 0, shift[0]], [0, 1.0, shift[1]]]), (160, 120)).astype(np.uint8)


def test_flow_follows_a_shift_in_drawings_and_in_clips():
    points = np.array([[60.0, 50.0], [80.25, 70.5], [100.0, 60.0]])
    shifts = np.array([(3.0 * t, 2.0 * t) for t in range(-2, 3)])
    frames = [picture(shift) for shift in shifts]
    expected = points + shifts[:, None]
    clip = baselines.flow_of_clip(iter(frames), 2, points)
    drawings = baselines.flow_of_drawings(frames, 2, points)
    assert np.abs(clip - expected).max() < FLOW_PIXELS
    assert np.abs(drawings - expected).max() < FLOW_PIXELS
    assert (clip[2] == points).all()
    assert (drawings[2] == points).all()
    assert (baselines.copy(points, 5) == points).all()
    with pytest.raises(ValueError, match="more than 5 frames, found 5"):
        baselines.flow_of_clip(iter(frames), 5, points)
