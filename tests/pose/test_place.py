import dataclasses

import numpy as np
import pytest

from tests.pose.boxes import box_puppet, crops_around
from wildpuppet.errors import PuppetError
from wildpuppet.geometry import affine
from wildpuppet.pose.place import place, pose_vertices, rest_box, size_of

PUPPET = box_puppet([(10, 6, 20, 10), (20, 12, 24, 30)])
REST = (10, 6, 34, 36)


def test_rest_box_is_what_is_drawn():
    np.testing.assert_allclose(rest_box(PUPPET), REST)


def test_transparent_puppet_is_refused():
    blank = dataclasses.replace(PUPPET, atlas=np.zeros_like(PUPPET.atlas))
    with pytest.raises(PuppetError, match="transparent"):
        rest_box(blank)


def test_rest_box_gets_the_boxs_area_and_centre():
    crops = crops_around(2, (400, 400), box=(200, 150, 68, 144))
    crop_from_canvas = place(PUPPET, crops)
    low, high = affine.apply(crop_from_canvas, np.array([[10.0, 6.0], [44.0, 42.0]]))
    np.testing.assert_allclose((low + high) / 2, [234.0, 222.0])
    assert np.prod(high - low) == pytest.approx(68 * 144)
    assert size_of(crop_from_canvas) == pytest.approx(np.sqrt(68 * 144 / (34 * 36)))
    np.testing.assert_allclose(crop_from_canvas[:, :2], size_of(crop_from_canvas) * np.eye(2))


def windows(num: int) -> np.ndarray:
    """Crops twice as fine as the video, each cut further right."""
    return np.stack([affine.scale_and_shift(0.5, (5.0 + 2 * t, 3.0)) for t in range(num)])


def test_puppet_drawn_on_the_picture_stays_where_it_was_drawn():
    video_from_crop = windows(3)
    box = (2 * (REST[0] - 5) + 3, 2 * (REST[1] - 3) - 2, 2 * REST[2], 2 * REST[3] + 4)  # drawn by hand: a bit off
    crops = crops_around(3, box=box, video_from_crop=video_from_crop)
    np.testing.assert_allclose(place(PUPPET, crops), affine.invert(video_from_crop[0]))


def test_reference_frame_decides():
    crops = crops_around(3, box=(2 * (REST[0] - 9), 6, 2 * REST[2], 2 * REST[3]), video_from_crop=windows(3))
    crops = dataclasses.replace(crops, reference=2)
    np.testing.assert_allclose(place(PUPPET, crops), affine.invert(windows(3)[2]))


def test_unordered_drawings_share_the_puppets_canvas():
    crops = crops_around(3, box=(0, 0, 5, 5), ordered=False)
    np.testing.assert_allclose(place(PUPPET, crops), [[1, 0, 0], [0, 1, 0]])


def test_layers_move_by_their_own_maps():
    maps = np.stack([affine.scale_and_shift(2.0, (1.0, -1.0)), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 5.0]])])
    moved = pose_vertices(PUPPET, maps[None])[0]
    rest = PUPPET.vertices
    np.testing.assert_allclose(moved[:4], 2 * rest[:4] + [1, -1])
    np.testing.assert_allclose(moved[4:], np.stack([-rest[4:, 1], rest[4:, 0] + 5], -1))
