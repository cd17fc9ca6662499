from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from tests.video.clips import bar_code, number_in
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.video.probe import probe
from wildpuppet.video.read import FrameReader
from wildpuppet.video.write import constant_times, write_preview


def test_uneven_times_and_odd_sizes_are_kept(tmp_path):
    pts = np.cumsum([7, 1, 2, 5, 1, 1, 30, 2, 2, 4])
    pictures = [bar_code(number, 161, 97) for number in range(10)]
    write_preview(tmp_path / "preview.mp4", pictures, pts, Fraction(1001, 24000))
    clip = probe(tmp_path / "preview.mp4", ProbeSettings(), Machine())
    assert clip.size == (162, 98)
    times = [time * clip.time_base for time in clip.pts.tolist()]
    assert times == [int(time - pts[0]) * Fraction(1001, 24000) for time in pts]
    with FrameReader(clip) as reader:
        assert [number_in(picture) for _, picture in reader.frames()] == list(range(10))


def test_colour_is_converted_and_tagged(tmp_path):
    colours = np.array([(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0), (200, 120, 60)], np.uint8)
    picture = np.repeat(np.repeat(colours[None], 120, 0), 40, 1)
    pts, time_base = constant_times(3, Fraction(24000, 1001))
    write_preview(tmp_path / "preview.mp4", [picture] * 3, pts, time_base)
    with av.open(str(tmp_path / "preview.mp4")) as container:
        frame = next(container.decode(video=0))
        tags = (frame.colorspace, frame.color_range, frame.color_primaries, frame.color_trc)
        assert tags == (1, 1, 1, 1)
        read = frame.to_ndarray(format="rgb24")
    assert np.abs(read[60, 20::40].astype(int) - colours).max() <= 3


def test_same_bytes_twice_and_index_first(tmp_path):
    pictures = [bar_code(number) for number in range(30)]
    pts, time_base = constant_times(30, Fraction(24))
    for name in ("a.mp4", "b.mp4"):
        write_preview(tmp_path / name, iter(pictures), pts, time_base)
    data = (tmp_path / "a.mp4").read_bytes()
    assert data == (tmp_path / "b.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


def test_a_soft_pan_has_the_same_bytes_every_time(tmp_path):
    soft = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
    soft = cv2.GaussianBlur(soft, (0, 0), 6)
    pts, time_base = constant_times(6, Fraction(24))
    written = set()
    for attempt in range(16):  # of a soft pan x264's macroblock tree gives every fourth file other bytes
        pan = [np.roll(soft, 3 * number, 1) for number in range(6)]
        write_preview(tmp_path / f"{attempt}.mp4", iter(pan), pts, time_base)
        written.add((tmp_path / f"{attempt}.mp4").read_bytes())
    assert len(written) == 1


def test_frames_must_match_times(tmp_path):
    pts, time_base = constant_times(3, Fraction(24))
    for count in (0, 2, 4):
        with pytest.raises(ValueError, match=r"expected at least one|argument"):
            write_preview(tmp_path / "preview.mp4", [bar_code(0)] * count, pts, time_base)
    assert list(tmp_path.iterdir()) == []
