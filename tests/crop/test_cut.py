import numpy as np
import pytest

from tests.track.drawn import DISC, Drawn, draw_clip, line
from wildpuppet.crop.cut import cut
from wildpuppet.crop.warp import cut_window
from wildpuppet.errors import InputError
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.settings import CropSettings
from wildpuppet.types import Crops, Target, Track

FRAMES = 24
AT = 6


def true_track(drawn: Drawn) -> Track:
    count = len(drawn.boxes)
    return Track(np.arange(count), drawn.boxes, ("followed",) * count, np.ones(count), np.zeros(count, int))


def cut_out(drawn: Drawn, **settings: float) -> Crops:
    target = Target(tuple(drawn.boxes[AT]), AT, 0, len(drawn.boxes))
    return cut(drawn.clip, true_track(drawn), target, CropSettings(**settings), Machine())


def in_crops(pictures: np.ndarray, crops: Crops) -> np.ndarray:
    return np.stack([cut_window(p, m, crops.size) for p, m in zip(pictures, crops.video_from_crop, strict=True)])


@pytest.fixture(scope="module")
def walking(tmp_path_factory) -> Drawn:
    path = tmp_path_factory.mktemp("walk") / "clip.mp4"
    return draw_clip(path, line((60, 100), (260, 110), FRAMES), camera=line((100, 100), (190, 110), FRAMES))


@pytest.fixture(scope="module")
def crops(walking) -> Crops:
    return cut_out(walking)


def test_crops_carry_what_the_next_stages_need(walking, crops):
    assert crops.frames.tolist() == list(range(FRAMES))
    assert crops.reference == AT
    assert len(crops.images) == FRAMES
    assert crops.images[0:2].shape == (2, crops.size[1], crops.size[0], 4)
    assert crops.images[3:3].shape == (0, crops.size[1], crops.size[0], 4)
    corners = np.stack([crops.box_crop[:, :2], crops.box_crop[:, :2] + crops.box_crop[:, 2:]], 1)
    back = affine.apply(crops.video_from_crop, corners)
    assert np.abs(back[:, 0] - walking.boxes[:, :2]).max() < 1e-9


def test_the_colours_are_the_videos_at_the_windows_place(walking, crops):
    wanted = in_crops(walking.pictures, crops)
    assert (
        np.abs(crops.images[:][..., :3].astype(int) - wanted).mean() < 5.0
    )  # the encoder's loss, mostly of colour detail


def test_slices_agree_in_any_order(crops):
    whole = crops.images[:]
    assert np.array_equal(crops.images[20:23], whole[20:23])
    assert np.array_equal(crops.images[2:9:3], whole[2:9:3])
    assert np.array_equal(crops.images[-2:], whole[-2:])


def test_the_matte_is_the_figure_where_the_background_was_seen(walking, crops):
    alpha, matte = in_crops(walking.alpha, crops), crops.images[:][..., 3]
    shared = ((matte > 128) & (alpha > 128)).sum() / ((matte > 128) | (alpha > 128)).sum()
    assert shared > 0.9
    assert (matte[alpha > 250] > 128).mean() > 0.98
    assert (matte[alpha > 250] < 26).mean() < 0.001  # hardly ever sure and wrong
    sure = (matte < 26) | (matte > 229)
    assert sure.mean() > 0.5
    assert ((matte > 128) == (alpha > 128))[sure].mean() > 0.995


def test_beyond_the_video_the_matte_is_unknown(tmp_path):
    drawn = draw_clip(tmp_path / "clip.mp4", line((40, 100), (20, 100), 8))
    crops = cut(drawn.clip, true_track(drawn), Target(tuple(drawn.boxes[0]), 0, 0, 8), CropSettings(), Machine())
    x = affine.apply(
        crops.video_from_crop[7], np.stack([np.arange(crops.size[0]) + 0.5, np.full(crops.size[0], 50.0)], 1)
    )
    beyond = x[:, 0] < 0
    assert beyond.any()
    assert (crops.images[7:8][0][:, beyond, 3] == 128).all()


def test_a_character_that_never_leaves_its_place_is_not_declared_background(tmp_path):
    drawn = draw_clip(tmp_path / "clip.mp4", np.tile([150.0, 100.0], (FRAMES, 1)))
    crops = cut_out(drawn)
    alpha, matte = in_crops(drawn.alpha, crops), crops.images[:][..., 3]
    assert (matte[alpha > 250] < 64).mean() < 0.01
    assert (matte[alpha > 250] > 128).mean() > 0.8
    far = (
        np.hypot(*(np.indices(crops.size[::-1]) - np.array(crops.size[::-1])[:, None, None] / 2)) > 0.45 * crops.size[1]
    )
    assert (matte[:, far] < 128).mean() > 0.99


def test_something_else_that_moves_behind_is_hardly_ever_sure_to_be_the_character(tmp_path):
    discs = line((60, 90), (150, 70), FRAMES)
    drawn = draw_clip(tmp_path / "clip.mp4", np.tile([160.0, 100.0], (FRAMES, 1)), discs=discs)
    crops = cut_out(drawn)
    alpha, matte = in_crops(drawn.alpha, crops), crops.images[:][..., 3]
    places = affine.apply(affine.invert(crops.video_from_crop), discs[:, None])[:, 0]
    y, x = np.indices(matte.shape[1:])
    disc = np.hypot(x - places[:, 0, None, None], y - places[:, 1, None, None]) < DISC - 3
    assert (matte[disc & (alpha < 5)] > 229).mean() < 0.1
    assert (matte[alpha > 250] < 64).mean() < 0.02


def test_without_mattes_everything_is_unknown(walking):
    assert (cut_out(walking, matte=False).images[:][..., 3] == 128).all()


def test_a_target_that_was_not_tracked_is_an_error(walking):
    with pytest.raises(InputError, match="--at 99"):
        cut(walking.clip, true_track(walking), Target(tuple(walking.boxes[0]), 99, 0, 100), CropSettings(), Machine())
