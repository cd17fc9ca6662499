"""Parts cut generously from one drawing give every pixel to one part; whole art is left alone."""

import cv2
import numpy as np
import pytest

from wildpuppet.puppet.copies import without_copies
from wildpuppet.types import CutOut, Part

ORANGE, WHITE, DARK = (240, 160, 60), (250, 245, 235), (60, 30, 20)


def picture() -> np.ndarray:
    """Draw an orange bar with an outlined white disc over its middle."""
    rgb = np.zeros((120, 200, 3), np.uint8)
    cv2.rectangle(rgb, (20, 40), (180, 80), ORANGE, -1)
    cv2.circle(rgb, (100, 60), 16, DARK, -1)
    cv2.circle(rgb, (100, 60), 13, WHITE, -1)
    return rgb


def cut(rgb: np.ndarray, name: str, mask: np.ndarray) -> Part:
    return Part(name, np.dstack([np.where(mask[..., None] > 0, rgb, 0), mask]).astype(np.uint8))


def boxed(x: int, y: int, right: int, bottom: int) -> np.ndarray:
    mask = np.zeros((120, 200), np.uint8)
    mask[y:bottom, x:right] = 255
    return mask


@pytest.fixture
def generous() -> CutOut:
    """Cut the bar with the disc still on it, and the disc with a square of the bar around it."""
    rgb = picture()
    return CutOut((200, 120), (cut(rgb, "bar", boxed(20, 40, 181, 81)), cut(rgb, "disc", boxed(80, 41, 121, 80))))


def test_the_part_in_front_loses_its_fringe(generous: CutOut) -> None:
    alpha = without_copies(generous, 16).parts[1].rgba[..., 3]
    rows, columns = np.indices(alpha.shape)
    distance = np.hypot(columns - 100, rows - 60)
    assert (alpha[distance < 15] == 255).all()
    fringe = (generous.parts[1].rgba[..., 3] > 0) & (distance > 18)
    assert (alpha[fringe] == 0).mean() > 0.9


def test_the_part_behind_loses_what_is_painted_on_it(generous: CutOut) -> None:
    before, after = generous.parts[0].rgba, without_copies(generous, 16).parts[0].rgba
    assert np.array_equal(before[..., 3], after[..., 3])
    inside = after[46:75, 30:170, :3].astype(int)
    assert np.abs(inside - ORANGE).max() <= 2
    assert np.array_equal(after[60, 25:70], before[60, 25:70])


def test_whole_art_stays_as_it_is() -> None:
    bar = np.zeros((120, 200, 3), np.uint8)
    cv2.rectangle(bar, (20, 40), (180, 80), ORANGE, -1)
    disc = picture()
    mask = np.zeros((120, 200), np.uint8)
    cv2.circle(mask, (100, 60), 16, 255, -1)
    whole = CutOut((200, 120), (cut(bar, "bar", boxed(20, 40, 181, 81)), cut(disc, "disc", mask)))
    for given, kept in zip(whole.parts, without_copies(whole, 16).parts, strict=True):
        assert np.array_equal(given.rgba, kept.rgba)
