import numpy as np
import pytest

from wildpuppet.crop.drawings import crops_of_drawings
from wildpuppet.errors import InputError
from wildpuppet.geometry import affine
from wildpuppet.settings import CropSettings

CANVAS = (300, 260)


def drawing(x: int, y: int, w: int, h: int) -> np.ndarray:
    image = np.zeros((CANVAS[1], CANVAS[0], 4), np.uint8)
    image[..., :3] = 250
    image[y : y + h, x : x + w] = (200, 30, 40, 255)
    return image


def test_one_window_holds_all_drawings_with_their_margin():
    images = np.stack([drawing(100, 60, 40, 120), drawing(90, 80, 70, 110)])
    crops = crops_of_drawings(["a.png", "b.png"], images, CANVAS, CropSettings(box_pixels=60, margin=0.25))
    assert (crops.video_from_crop == crops.video_from_crop[0]).all()
    assert crops.video_from_crop[0, 0, 0] == pytest.approx(2.0)  # the largest side, 120, becomes 60
    assert crops.size == (66, 96)  # 70 + 60 and 130 + 60 (y from 60 to 190), halved, even
    corners = affine.apply(
        crops.video_from_crop, np.stack([crops.box_crop[:, :2], crops.box_crop[:, :2] + crops.box_crop[:, 2:]], 1)
    )
    assert np.allclose(corners[0], [[100, 60], [140, 180]])
    assert np.allclose(corners[1], [[90, 80], [160, 190]])
    assert (crops.ordered, crops.reference) == (False, None)
    assert crops.drawing.tolist() == [0, 1]
    assert crops.state == ("followed", "followed")


def test_crops_of_drawings_keep_colour_and_matte_in_place():
    images = np.stack([drawing(100, 60, 40, 120)])
    crops = crops_of_drawings(["a.png"], images, CANVAS, CropSettings(box_pixels=224))
    assert crops.video_from_crop[0, 0, 0] == 1.0
    crop = crops.images[0:1][0]
    x, y, w, h = crops.box_crop[0].astype(int)
    assert (crop[y : y + h, x : x + w] == (200, 30, 40, 255)).all()
    outside = crop[..., 3].copy()
    outside[y : y + h, x : x + w] = 0
    assert (outside == 0).all()


def test_beyond_the_canvas_the_matte_is_empty():
    images = np.stack([drawing(0, 0, 300, 260)])
    crops = crops_of_drawings(["a.png"], images, CANVAS, CropSettings(box_pixels=1024, margin=0.1))
    crop = crops.images[0:1][0]
    x, y, _, h = crops.box_crop[0].astype(int)
    assert x > 0
    assert (crop[:, :x, 3] == 0).all()
    assert (crop[y + h :, :, 3] == 0).all()


def test_an_empty_drawing_is_named():
    images = np.stack([drawing(100, 60, 40, 120), drawing(0, 0, 0, 0)])
    with pytest.raises(InputError, match=r"second\.png"):
        crops_of_drawings(["first.png", "second.png"], images, CANVAS, CropSettings())
