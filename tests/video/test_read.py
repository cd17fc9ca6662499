from contextlib import closing

import numpy as np
import pytest

from tests.video.clips import bar_code, encode, number_in
from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.video.probe import probe
from wildpuppet.video.read import FrameReader


def probed(path):
    return probe(path, ProbeSettings(), Machine())


def assert_reads_as_decoded(clip):
    """Every way to read frame i gives the very picture of the sequential pass."""
    with FrameReader(clip) as reader:
        whole = [picture.copy() for _, picture in reader.frames()]
        assert len(whole) == clip.num_frames
        order = np.random.default_rng(1).permutation(clip.num_frames)[:12].tolist()
        for number in [*order, clip.num_frames - 1, 0, 1, 2]:
            assert np.array_equal(reader.frame(number), whole[number]), number
        start, end = clip.num_frames // 3, clip.num_frames // 3 + 5
        both = zip(reader.frames(start, end), reader.frames(0, 5), strict=True)
        for offset, ((number, picture), (other, beside)) in enumerate(both):
            assert (number, other) == (start + offset, offset)
            assert np.array_equal(picture, whole[number])
            assert np.array_equal(beside, whole[other])
    return whole


LONG_GROUP = {"g": "250", "bf": "5", "b_strategy": "0", "preset": "fast"}


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("long.mp4", "libx264", LONG_GROUP),
        ("long.mkv", "libx264", LONG_GROUP),
        ("open.mp4", "libx264", {"g": "20", "bf": "3", "x264-params": "open-gop=1:b-adapt=0"}),
        ("open.ts", "libx264", {"g": "20", "bf": "3", "x264-params": "open-gop=1:b-adapt=0"}),
        ("refresh.mp4", "libx264", {"g": "30", "x264-params": "intra-refresh=1"}),
        ("open265.mp4", "libx265", {"x265-params": "keyint=20:bframes=4:open-gop=1:log-level=none", "preset": "fast"}),
        ("programme.mpg", "mpeg2video", {"g": "15", "bf": "2", "b": "2M"}),
        ("clip.webm", "libvpx", {"deadline": "realtime", "b": "500k", "g": "30"}),
        ("counted.avi", "libx264", {"g": "20", "bf": "3"}),
        ("raw.h264", "libx264", {"g": "20", "bf": "3"}),
    ],
)
def test_frame_is_the_frame_drawn(tmp_path, name, codec, options):
    clip = probed(encode(tmp_path / name, [bar_code(n) for n in range(80)], codec=codec, **options))
    assert [number_in(picture) for picture in assert_reads_as_decoded(clip)] == list(range(80))


def test_uneven_times(tmp_path):
    pts = np.cumsum(np.random.default_rng(2).integers(1, 90, 100)).tolist()
    path = encode(tmp_path / "uneven.mp4", [bar_code(n) for n in range(100)], pts, g="33", bf="3")
    assert [number_in(picture) for picture in assert_reads_as_decoded(probed(path))] == list(range(100))


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_rotation_is_applied(tmp_path, turns):
    stored = [np.ascontiguousarray(np.rot90(bar_code(n, 128, 160), -turns)) for n in range(10)]
    clip = probed(encode(tmp_path / "turned.mp4", stored, rotation=90 * turns))
    assert [number_in(picture) for picture in assert_reads_as_decoded(clip)] == list(range(10))


def test_gif(tmp_path):
    clip = probed(encode(tmp_path / "clip.gif", [bar_code(n) for n in range(20)], codec="gif", pixel_format="rgb8"))
    assert [number_in(picture) for picture in assert_reads_as_decoded(clip)] == list(range(20))


def test_truncated_file_repeats_the_last_good_picture(tmp_path):
    noise = np.random.default_rng(3).integers(0, 255, (30, 24, 160, 3), np.uint8)
    pictures = [bar_code(n) for n in range(30)]
    for picture, texture in zip(pictures, noise, strict=True):
        picture[72:] = texture
    path = encode(tmp_path / "whole.mp4", pictures, g="1", bf="0")
    whole = path.read_bytes()
    (tmp_path / "broken.mp4").write_bytes(whole[: len(whole) * 2 // 3])
    clip = probed(tmp_path / "broken.mp4")
    assert 15 < clip.num_frames < 25
    numbers = [number_in(picture) for picture in assert_reads_as_decoded(clip)]
    assert numbers[: clip.num_frames - 1] == list(range(clip.num_frames - 1))


def test_damaged_packets_are_counted_and_repeat(tmp_path):
    path = encode(tmp_path / "clip.mkv", [bar_code(n) for n in range(60)], codec="ffv1", pixel_format="bgr0", g="1")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = bytes(3000)
    path.write_bytes(data)
    clip = probed(path)
    numbers = [number_in(picture) for picture in assert_reads_as_decoded(clip)]
    assert len(clip.bad_frames) >= 1
    for number in clip.bad_frames:
        assert numbers[number] == numbers[number - 1]


@pytest.mark.parametrize(("height", "colorspace"), [(240, 5), (720, 1)])
def test_untagged_colour_follows_the_height(tmp_path, height, colorspace):
    import av

    red = np.full((height, 320, 3), (220, 40, 60), np.uint8)
    path = tmp_path / "red.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=24, options={"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = 320, height, "yuv420p"
        frame = av.VideoFrame.from_ndarray(red, format="rgb24")
        container.mux(stream.encode(frame.reformat(format="yuv420p", dst_colorspace=colorspace)))
        container.mux(stream.encode())
    with FrameReader(probed(path)) as reader:
        assert np.abs(reader.frame(0).astype(int) - red).max() <= 3


def test_ranges_outside_the_clip_are_refused(tmp_path):
    clip = probed(encode(tmp_path / "clip.mp4", [bar_code(n) for n in range(5)]))
    with FrameReader(clip) as reader:
        assert [number for number, _ in reader.frames(2)] == [2, 3, 4]
        assert list(reader.frames(3, 3)) == []
        for start, end in [(-1, 3), (0, 6), (4, 3)]:
            with pytest.raises(InputError, match="from 0 to 5"):
                reader.frames(start, end)
        with closing(reader.frames(0, 5)) as frames:
            next(frames)


def test_changed_file_is_noticed(tmp_path):
    path = encode(tmp_path / "clip.mp4", [bar_code(n) for n in range(30)])
    clip = probed(path)
    encode(path, [bar_code(n) for n in range(10)])
    with FrameReader(clip) as reader, pytest.raises(InputError, match="has changed"):
        list(reader.frames())
