import numpy as np
import pytest

from tests.track.drawn import Drawn, draw_clip, line, overlap
from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.settings import TrackSettings
from wildpuppet.track.follow import track
from wildpuppet.types import Target, Track

FRAMES = 30


def followed(drawn: Drawn, at: int, **settings: float) -> tuple[Track, np.ndarray]:
    target = Target(tuple(drawn.boxes[at]), at, 0, len(drawn.boxes))
    found = track(drawn.clip, target, TrackSettings(**settings), Machine())
    return found, overlap(found.boxes_video, drawn.boxes)


def test_a_walk_is_followed_to_both_ends_under_a_still_camera(tmp_path):
    drawn = draw_clip(tmp_path / "clip.mp4", line((60, 100), (260, 110), FRAMES))
    found, shared = followed(drawn, 12)
    assert found.frames.tolist() == list(range(FRAMES))
    assert set(found.state) == {"followed"}
    assert np.array_equal(found.boxes_video[12], drawn.boxes[12])
    assert shared.min() > 0.85
    assert found.score.min() > 0.6


def test_a_pan_does_not_carry_the_box_along(tmp_path):
    drawn = draw_clip(
        tmp_path / "clip.mp4", line((120, 100), (200, 90), FRAMES), camera=line((100, 100), (420, 140), FRAMES)
    )
    assert followed(drawn, 20)[1].min() > 0.85


def test_a_zoom_and_a_growing_character_are_followed(tmp_path):
    drawn = draw_clip(
        tmp_path / "clip.mp4",
        line((120, 100), (200, 100), FRAMES),
        scales=np.linspace(0.7, 1.4, FRAMES),
        zoom=np.linspace(0.8, 1.2, FRAMES),
    )
    found, shared = followed(drawn, 0)
    assert shared.min() > 0.5
    assert shared.mean() > 0.75
    assert set(found.state) == {"followed"}


def test_a_character_that_hardly_moves_is_not_taken_for_background(tmp_path):
    sway = np.arange(FRAMES) / 3.0
    drawn = draw_clip(tmp_path / "clip.mp4", np.stack([150 + 4 * np.sin(sway), 100 + 3 * np.cos(sway)], 1))
    assert followed(drawn, 5)[1].min() > 0.75


def test_what_leaves_is_lost_and_found_when_it_comes_back(tmp_path):
    x = np.r_[np.linspace(200, 370, 18), np.full(8, 370.0), np.linspace(370, 150, 22)]
    drawn = draw_clip(tmp_path / "clip.mp4", np.stack([x, np.full(48, 100.0)], 1))
    found, shared = followed(drawn, 3)
    outside = np.flatnonzero(x > 350)
    assert {found.state[t] for t in outside} == {"lost"}
    assert "found" in found.state[outside[-1] :]
    assert shared[:12].min() > 0.85
    assert shared[-5:].min() > 0.85
    assert found.score[outside].max() < 0.35


def test_what_leaves_from_where_it_stood_and_comes_back_there_is_not_seen_in_the_background(tmp_path):
    x = np.r_[np.linspace(60, -40, 8), np.full(8, -40.0), np.linspace(-40, 60, 8)]
    drawn = draw_clip(tmp_path / "clip.mp4", np.stack([x, np.full(24, 100.0)], 1))
    found, shared = followed(drawn, 1)
    assert {found.state[t] for t in np.flatnonzero(x < -30)} == {"lost"}
    assert {found.state[t] for t in np.flatnonzero(x > 10)} <= {"followed", "found"}
    assert shared[x > 30].min() > 0.6


def test_a_short_absence_from_the_picture_is_not_bridged(tmp_path):
    x = np.r_[np.linspace(60, -40, 8), np.full(3, -40.0), np.linspace(-40, 60, 8)]
    drawn = draw_clip(tmp_path / "clip.mp4", np.stack([x, np.full(19, 100.0)], 1))
    found, _ = followed(drawn, 1)
    assert {found.state[t] for t in np.flatnonzero(x < -30)} == {"lost"}


def test_after_a_cut_the_character_is_followed_in_another_pose_and_size(tmp_path):
    centres = np.concatenate([line((80, 100), (80, 100), 8), line((230, 110), (200, 110), 10)])
    seeds, scales = np.repeat([0, 1], [8, 10]), np.r_[np.ones(8), np.linspace(0.75, 0.6, 10)]
    drawn = draw_clip(tmp_path / "clip.mp4", centres, scales=scales, seeds=seeds)
    found, shared = followed(drawn, 2)
    assert found.state[8] == "found"
    assert set(found.state[9:]) == {"followed"}
    assert shared[seeds == 1].min() > 0.5


def test_a_short_gap_is_bridged(tmp_path):
    shown = ~np.isin(np.arange(FRAMES), range(14, 19))
    drawn = draw_clip(tmp_path / "clip.mp4", line((80, 100), (200, 100), FRAMES), shown=shown)
    found, shared = followed(drawn, 3)
    assert [t for t in range(FRAMES) if found.state[t] == "bridged"] == list(range(14, 19))
    assert shared.min() > 0.8


def test_after_a_cut_the_character_is_found_in_the_next_shot_and_not_in_one_without_it(tmp_path):
    centres = np.concatenate(
        [line((80, 100), (140, 100), 14), np.tile([140.0, 100.0], (8, 1)), line((230, 80), (180, 90), 14)]
    )
    seeds = np.repeat([0, 1, 2], [14, 8, 14])
    drawn = draw_clip(tmp_path / "clip.mp4", centres, seeds=seeds, shown=seeds != 1)
    assert drawn.clip.shot_starts == (0, 14, 22)
    found, shared = followed(drawn, 5)
    assert found.shot.tolist() == seeds.tolist()
    assert set(found.state[14:22]) == {"lost"}
    assert found.state[22] == "found"
    assert shared[seeds == 0].min() > 0.6
    assert shared[seeds == 2].min() > 0.6


def test_the_same_input_gives_the_same_boxes(tmp_path):
    drawn = draw_clip(tmp_path / "clip.mp4", line((80, 100), (160, 100), 12))
    assert np.array_equal(followed(drawn, 2)[0].boxes_video, followed(drawn, 2)[0].boxes_video)


@pytest.mark.parametrize(
    ("box", "at", "start", "end", "says"),
    [
        ((400.0, 10.0, 50.0, 50.0), 2, 0, 6, "inside the frame of 320 by 200"),
        ((10.0, 10.0, 0.0, 50.0), 2, 0, 6, "0 by 50"),
        ((10.0, 10.0, float("nan"), 50.0), 2, 0, 6, "at least 2 pixels"),
        ((10.0, 10.0, 50.0, 50.0), 7, 0, 6, "--at 7 is outside the range 0 to 6"),
        ((10.0, 10.0, 50.0, 50.0), 2, 3, 3, "the range is empty"),
        ((10.0, 10.0, 50.0, 50.0), 2, 0, 99, "the clip has frames 0 to 6"),
    ],
)
def test_what_cannot_be_followed_is_one_clear_line(tmp_path, box, at, start, end, says):
    drawn = draw_clip(tmp_path / "clip.mp4", line((80, 100), (90, 100), 6))
    with pytest.raises(InputError, match=says) as caught:
        track(drawn.clip, Target(box, at, start, end), TrackSettings(), Machine())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("box", "at", "start", "end"),
    [
        ((0.0, 0.0, 320.0, 200.0), 3, 0, 6),
        ((-40.0, -30.0, 400.0, 260.0), 3, 0, 6),
        ((-45.0, 50.0, 60.0, 80.0), 0, 0, 6),
        ((100.0, 10.0, 4.0, 180.0), 3, 0, 6),
        ((100.0, 90.0, 5.0, 6.0), 3, 0, 6),
        ((60.0, 70.0, 48.0, 64.0), 3, 3, 4),
    ],
)
def test_odd_boxes_and_single_frames_give_a_box_per_frame(tmp_path, box, at, start, end):
    drawn = draw_clip(tmp_path / "clip.mp4", line((80, 100), (90, 100), 6))
    found = track(drawn.clip, Target(box, at, start, end), TrackSettings(), Machine())
    assert found.frames.tolist() == list(range(start, end))
    assert np.isfinite(found.boxes_video).all()
    assert (found.boxes_video[:, 2:] > 0).all()
    assert np.array_equal(found.boxes_video[at - start], box)
