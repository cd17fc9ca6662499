import pytest

from tests.track.drawn import draw_clip, line, overlap
from wildpuppet.errors import SettingsError
from wildpuppet.machine import Machine
from wildpuppet.settings import TrackSettings
from wildpuppet.track.follow import track
from wildpuppet.track.trackers import make_tracker
from wildpuppet.types import Target


@pytest.mark.parametrize("method", ["csrt", "kcf", "mil"])
def test_every_tracker_without_a_model_follows(tmp_path, method):
    drawn = draw_clip(tmp_path / "clip.mp4", line((70, 100), (190, 108), 16))
    target = Target(tuple(drawn.boxes[4]), 4, 0, 16)
    boxes = track(drawn.clip, target, TrackSettings(method=method), Machine()).boxes_video
    assert overlap(boxes, drawn.boxes).min() > 0.75


@pytest.mark.parametrize(
    ("method", "model", "says"),
    [
        ("nano", "", "needs 2 model file"),
        ("vit", "", "needs 1 model file"),
        ("dasiamrpn", "one.onnx,two.onnx", "found 2"),
        ("vit", "nowhere.onnx", "no file nowhere.onnx"),
    ],
)
def test_missing_models_are_named(method, model, says):
    with pytest.raises(SettingsError, match=says):
        make_tracker(TrackSettings(method=method, model=model))


def test_a_file_that_is_no_model_is_one_clear_line(tmp_path):
    file = tmp_path / "not_a_model.onnx"
    file.write_text("hello")
    with pytest.raises(SettingsError, match="cannot read") as caught:
        make_tracker(TrackSettings(method="vit", model=str(file)))
    assert "\n" not in str(caught.value)
