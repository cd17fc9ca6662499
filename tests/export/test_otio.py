import numpy as np
import opentimelineio as otio
import pytest

from tests.export.moving import FIRST, LOST, NUM_FRAMES, SHOT, moving
from wildpuppet.export import otio as writer
from wildpuppet.export.options import Options
from wildpuppet.machine import silent

UNEVEN = np.array([0, 800, 1600, 3600, 4400, 5200, 6000, 7200])
SECONDS = 1e-9


@pytest.mark.parametrize("pts", [None, UNEVEN])
def test_opentimelineio_reads_a_clip_per_shot(tmp_path, pts):
    world = moving(pts=pts)
    writer.write(world.animation, tmp_path, Options(), silent)
    timeline = otio.adapters.read_from_file(str(tmp_path / "hero_run.otio"))
    assert timeline.name == "hero run"
    (track,) = timeline.video_tracks()
    clips = list(track.find_clips())
    assert [clip.name for clip in clips] == ["shot 1", "shot 2"]
    timing = world.animation.timing
    start = [FIRST / float(timing.rate) + float(timing.seconds(t)) for t in (0, SHOT)]
    for clip, begin, end in zip(clips, start, (start[1], FIRST / float(timing.rate) + float(timing.end_seconds())),
                                strict=True):  # fmt: skip
        assert abs(clip.source_range.start_time.to_seconds() - begin) < SECONDS
        assert abs(clip.source_range.duration.to_seconds() - (end - begin)) < SECONDS
        there, used = clip.media_reference.available_range, clip.source_range
        assert there.start_time <= used.start_time
        assert used.end_time_exclusive() <= there.end_time_exclusive()
    assert abs(track.duration().to_seconds() - float(timing.end_seconds())) < SECONDS
    assert clips[0].metadata["wildpuppet"] == {"first_frame": FIRST, "last_frame": FIRST + SHOT - 1}
    ((marker,), ()) = (list(clip.markers) for clip in clips)
    expected = float(timing.seconds(LOST + 1) - timing.seconds(LOST))
    assert abs(marker.marked_range.duration.to_seconds() - expected) < SECONDS
    if pts is None:
        assert clips[1].source_range.start_time.value == FIRST + SHOT
        assert clips[1].source_range.duration.value == NUM_FRAMES - SHOT
