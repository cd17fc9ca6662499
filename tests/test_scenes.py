import av
import numpy as np
import pytest

from tests.scenes import make_scene, write_clip


@pytest.mark.parametrize("kind", ["walk", "crossing", "hidden", "order", "pan", "zoom", "cut", "twos"])
def test_the_picture_shows_the_part_where_the_truth_says(kind):
    scene = make_scene(kind, frames=8, size=(320, 240), seed=3)
    for layer, part in enumerate(scene.cutout.parts):
        points = scene.points_of(layer)
        expected = part.rgba[tuple(np.floor(points).astype(int).T[::-1])][:, :3].astype(float)
        seen, where = scene.visible(points, layer), np.floor(scene.truth(points, layer)).astype(int)
        for frame in range(8):
            x, y = where[frame, seen[frame]].T
            shown, wanted = scene.frames[frame, y, x].astype(float), expected[seen[frame]]
            if len(wanted) > 12:  # patterns blur a little and an edge of a part above may touch: the bulk must agree
                assert np.median(np.abs(shown - wanted).mean(1)) < 30, (part.name, frame)


def test_kinds_are_what_they_say():
    scene = make_scene("hidden", frames=9)
    hand = scene.layer("left_forearm")
    seen = scene.visible(scene.points_of(hand), hand).mean(1)
    assert seen[0] > 0.7
    assert seen[4] == 0.0
    order = make_scene("order", frames=9).order
    assert (order[0] != order[8]).any()
    twos = make_scene("twos", frames=6)
    np.testing.assert_array_equal(twos.drawing, [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(twos.frames[0], twos.frames[1])
    assert (twos.frames[1] != twos.frames[2]).any()
    cut = make_scene("cut", frames=8)
    assert cut.shot_starts == (0, 4)
    change = np.abs(np.diff(cut.frames.astype(float), axis=0)).mean((1, 2, 3))
    assert change.argmax() == 3


def test_identical_limbs_and_seeds():
    parts = make_scene(frames=1, identical=True)
    left, right = (parts.cutout.parts[parts.layer(f"{side}_thigh")].rgba for side in ("left", "right"))
    middles = [rgba[140:180][rgba[140:180, :, 3] == 255][:, :3].mean(0) for rgba in (left, right)]
    assert np.abs(middles[0] - middles[1]).max() < 12
    np.testing.assert_array_equal(make_scene(frames=2, seed=1).frames, make_scene(frames=2, seed=1).frames)
    assert (make_scene(frames=2, seed=1).frames != make_scene(frames=2, seed=2).frames).any()


def test_written_clip_reads_back(tmp_path):
    scene = make_scene(frames=5)
    with av.open(str(write_clip(scene, tmp_path / "clip.mp4"))) as container:
        read = np.stack([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])
    assert read.shape == scene.frames.shape
    assert np.abs(read.astype(float) - scene.frames).mean() < 3.5
