import hashlib
from fractions import Fraction

import av
import numpy as np
import pytest

from tests.video.clips import bar_code, encode
from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.settings import ProbeSettings
from wildpuppet.video.probe import probe


def probed(path):
    return probe(path, ProbeSettings(), Machine())


def test_uneven_times_are_exact(tmp_path):
    pts = np.cumsum([0, 20, 20, 50, 10, 25, 25, 200, 24, 24, 1, 2])
    path = encode(tmp_path / "uneven.mp4", [bar_code(n) for n in range(len(pts))], pts.tolist())
    clip = probed(path)
    assert [time * clip.time_base for time in clip.pts.tolist()] == [Fraction(int(time), 600) for time in pts]
    assert clip.digest == hashlib.blake2b(path.read_bytes(), digest_size=32).hexdigest()
    assert clip.shot_starts == (0,)
    assert clip.bad_frames == ()


@pytest.mark.parametrize("rotation", [0, 90, 180, 270])
def test_size_is_upright(tmp_path, rotation):
    clip = probed(encode(tmp_path / "turned.mp4", [bar_code(n) for n in range(3)], rotation=rotation))
    assert clip.size == ((96, 160) if rotation in (90, 270) else (160, 96))


def test_cover_picture_is_not_the_video(tmp_path):
    clip = probed(encode(tmp_path / "covered.mp4", [bar_code(n) for n in range(7)], cover=True))
    assert (clip.num_frames, clip.size) == (7, (160, 96))


def test_containers_without_presentation_times_are_counted(tmp_path):
    pictures = [bar_code(n) for n in range(30)]
    for name in ("counted.avi", "counted.h264"):
        assert probed(encode(tmp_path / name, pictures)).num_frames == 30


def test_progress_ends_at_the_total(tmp_path):
    path = encode(tmp_path / "clip.mp4", [bar_code(n) for n in range(9)])
    calls = []
    probe(path, ProbeSettings(), Machine(progress=lambda done, total: calls.append((done, total))))
    assert calls[-1] == (9, 9)
    assert calls == sorted(calls)


def test_mistakes_are_one_clear_line(tmp_path):
    (tmp_path / "text.mp4").write_text("not a video at all, whatever its name says\n")
    (tmp_path / "text.txt").write_text("FFmpeg would draw this as a picture\n")
    (tmp_path / "empty.mp4").touch()
    with av.open(str(tmp_path / "sound.m4a"), "w", format="mp4") as container:
        stream = container.add_stream("aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 2048), np.float32), format="fltp", layout="mono")
        frame.sample_rate, frame.pts = 8000, 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    for name, expected in [
        ("nothing.mp4", "found nothing there"),
        (".", "found a folder"),
        ("text.mp4", "expected a video file"),
        ("text.txt", "expected a video file"),
        ("empty.mp4", "expected a video file"),
        ("sound.m4a", "found no video stream"),
    ]:
        with pytest.raises(InputError, match=expected) as caught:
            probed(tmp_path / name)
        assert "\n" not in str(caught.value)
