import json
from dataclasses import replace

import av
import cv2
import numpy as np
import pytest

from tests.export.moving import HELD, LOST, NUM_FRAMES
from tests.paint.film import HIDDEN, PAINT, film, over, repainted, with_spot, written
from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import scale_and_shift
from wildpuppet.paint.paint import Job, paint
from wildpuppet.paint.texture import canvas_pictures, edited


def far(picture, colour):
    """Largest difference of any channel from a colour."""
    return np.abs(picture.astype(int) - np.array(colour)).max(-1)


@pytest.fixture(scope="module")
def spotted(tmp_path_factory):
    drawn = film()
    out = paint(
        Job(drawn.animation, with_spot(drawn.scene.puppet), "original", drawn), tmp_path_factory.mktemp("p") / "o"
    )
    return drawn, out, written(out)


def test_a_spot_goes_where_the_arm_goes_and_nothing_else_changes(spotted):
    drawn, _, pictures = spotted
    for t, picture in enumerate(pictures):
        spot, hidden = drawn.spot(t), drawn.scene.layer(t, 0)[..., 3] > 0 if t in HIDDEN else np.zeros(1, bool)
        shown = np.where(hidden, 0.0, spot) if t != LOST else np.zeros_like(spot)
        assert (picture[..., 3] == 255).all()
        assert (far(picture[..., :3], PAINT)[shown > 0.999] <= 6).all()
        assert (shown > 0.999).sum() > 30 or t == LOST
        size = 7 if t in HIDDEN else 3  # beside an outline the frame's own edge decides
        reach = cv2.dilate((shown > 0.0).astype(np.uint8), np.ones((size, size), np.uint8)) > 0
        assert (picture[~reach][:, :3] == drawn.frames[t][~reach]).all()
    assert (pictures[LOST][..., :3] == drawn.frames[LOST]).all()
    covered = (drawn.spot(HIDDEN[0]) > 0.5) & (drawn.scene.layer(HIDDEN[0], 0)[..., 3] == 255)
    assert covered.sum() > 10, "the body should hide a piece of the spot"


def test_what_is_written_beside_the_frames(spotted):
    _, out, pictures = spotted
    said = json.loads((out / "manifest.json").read_text())
    assert said["painted_parts"] == ["arm"]
    assert (said["over"], said["light_changes"], said["first_frame"]) == ("original", False, 100)
    assert {f"frames/frame.{100 + t:05d}.png" for t in range(NUM_FRAMES)} <= set(said["files"])
    with av.open(str(out / "preview.mp4")) as video:
        seen = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert len(seen) == NUM_FRAMES
    assert np.abs(seen[1].astype(int) - pictures[1][..., :3]).mean() < 6


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.2, -0.9), (-1.0, 1.3)])
def test_no_rim_of_the_old_colour_where_the_fit_is_off(shift, tmp_path):
    drawn = film(noise=1)
    moved = scale_and_shift(1.0, shift)
    placed = drawn.animation.video_from_crop.copy()
    placed[..., 2] += moved[:, 2]
    animation = replace(drawn.animation, video_from_crop=placed)
    edit = repainted(drawn.scene.puppet, "arm")
    pictures = written(paint(Job(animation, edit, "original", drawn), tmp_path / "out"))
    for t in (0, 3, 5):
        arm = drawn.scene.layer(t, 1)
        new = arm.copy()
        new[..., :3] = arm[..., 3:] / 255.0 * np.array(PAINT)
        rest = over(drawn.scene.layer(t, 0), drawn.ground)
        truth, was = over(new, rest), over(arm, rest)
        painted = np.abs(truth - was).max(-1) > 60
        error = np.abs(pictures[t][..., :3] - truth).max(-1)
        left = np.abs(pictures[t][..., :3] - was).max(-1) < 25
        assert (left & painted).sum() <= 0.01 * painted.sum()
        assert np.percentile(error, 99) < 40
        rim = cv2.dilate((arm[..., 3] > 0).astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
        assert (pictures[t][rim][:, :3] == drawn.frames[t][rim]).all()


def test_what_stands_in_front_of_the_character_stays(tmp_path):
    drawn = film()
    for t in range(NUM_FRAMES):
        drawn.frames[t, :, 100 + t : 112 + t] = (240, 230, 90)
    pictures = written(
        paint(Job(drawn.animation, repainted(drawn.scene.puppet, "arm"), "original", drawn), tmp_path / "out")
    )
    for t, picture in enumerate(pictures):
        assert (picture[:, 102 + t : 110 + t, :3] == (240, 230, 90)).all()
        if t < LOST:
            arm = drawn.scene.layer(t, 1)[..., 3] == 255
            arm[:, 96 + t : 116 + t] = False
            assert np.median(far(picture[..., :3], PAINT)[arm]) <= 6


def test_paint_takes_the_frame_s_light(tmp_path):
    light = np.linspace(1.0, 0.5, NUM_FRAMES)
    drawn = film(light=light)
    out = paint(Job(drawn.animation, with_spot(drawn.scene.puppet), "original", drawn), tmp_path / "out")
    for t, picture in enumerate(written(out)[:LOST]):
        spot = np.median(picture[drawn.spot(t) > 0.999][:, :3], axis=0)
        assert np.abs(spot - np.array(PAINT) * light[t]).max() <= 5
    assert json.loads((out / "manifest.json").read_text())["light_changes"]


def test_what_was_rubbed_out_shows_what_lies_behind(tmp_path):
    drawn = film(noise=0)
    before = canvas_pictures(drawn.scene.puppet)
    picture = before["arm"].copy()
    picture[44:56, 92:130, 3] = 0
    edit = edited(drawn.scene.puppet, before, {"arm": picture})
    assert edit.erases
    shown = written(paint(Job(drawn.animation, edit, "original", drawn, drawn), tmp_path / "out"))[0][..., :3]
    body = drawn.scene.layer(0, 0)[..., 3] == 255
    hole = np.zeros(body.shape, bool)
    hole[46:54, 94:128] = True
    assert (far(shown, (200, 60, 40))[hole & body] <= 2).all()
    beside = hole & (drawn.scene.layer(0, 0)[..., 3] == 0)
    assert (np.abs(shown.astype(int) - drawn.ground)[beside] <= 2).all()
    hole = cv2.dilate(hole.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert (shown[~hole] == drawn.frames[0][~hole]).all()


def test_held_drawings_come_out_identical(tmp_path):
    drawn = film()
    placed = drawn.animation.video_from_crop.copy()
    placed[HELD] = placed[HELD - 1]
    drawn.frames[HELD] = drawn.frames[HELD - 1]
    animation = replace(drawn.animation, video_from_crop=placed)
    job = Job(animation, repainted(drawn.scene.puppet, "arm"), "original", drawn)
    pictures = written(paint(job, tmp_path / "out"))
    assert (pictures[HELD] == pictures[HELD - 1]).all()
    assert not (pictures[HELD] == pictures[HELD + 1]).all()


def test_over_the_plate_and_over_nothing(tmp_path):
    drawn = film(noise=0)
    edit = repainted(drawn.scene.puppet, "arm")
    alone = written(paint(Job(drawn.animation, edit, "none"), tmp_path / "none"))
    plate = written(paint(Job(drawn.animation, edit, "plate", drawn, drawn), tmp_path / "plate"))
    for t in range(NUM_FRAMES):
        alpha = drawn.scene.combined(t)[..., 3]
        assert np.abs(alone[t][..., 3] - alpha).max() <= 3
        empty = alpha == 0
        assert (plate[t][empty][:, :3] == drawn.ground[empty]).all()
    arm = drawn.scene.layer(3, 1)[..., 3] == 255
    assert (far(alone[3][..., :3], PAINT)[arm] <= 2).all()
    assert (far(plate[3][..., :3], PAINT)[arm] <= 2).all()


def test_nothing_of_the_persons_is_overwritten(tmp_path):
    drawn = film()
    job = Job(drawn.animation, with_spot(drawn.scene.puppet), "none")
    out = paint(job, tmp_path / "out")
    assert paint(job, out) == out
    (out / "frames" / "note.txt").write_text("mine")
    with pytest.raises(InputError, match=r"note.txt was changed or added"):
        paint(job, out)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.txt").write_text("mine")
    with pytest.raises(InputError, match="holds other files"):
        paint(job, tmp_path / "mine")
