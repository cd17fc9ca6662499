from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace
from PIL import Image

from tests.export.moving import FILM, FIRST, LOST, NUM_FRAMES, moving
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.options import Options

LEVELS = 2.0
"""Our bilinear samples against OpenCV's, premultiplied, in grey levels: both round."""
EDGE_SHARE = 0.002
"""Share of pixels that may differ: where the meshes' borders lie, alpha 0 is cut a texel earlier than OpenCV's."""
PRORES_LEVELS, WEBM_ALPHA_LEVELS, WEBM_SHARE = 3.0, 16.0, 0.05


@pytest.fixture(scope="module")
def world():
    return moving()


def premultiplied(rgba):
    rgba = rgba.astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:] / 255.0
    return rgba


def assert_like(found, expected, levels=LEVELS, share=EDGE_SHARE):
    distance = np.abs(premultiplied(found) - expected).max(-1)
    assert (distance > levels).mean() <= share, distance.max()


def test_png_layers_show_the_parts_where_they_are(tmp_path, world):
    folder = export(world.animation, format_of("png"), tmp_path)
    stack = {}
    for stem in ("combined/combined", "layers/body/body", "layers/arm/arm"):
        for t in range(NUM_FRAMES):
            file = folder / f"{stem}.{FIRST + t:05d}.png"
            by_opencv = cv2.cvtColor(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)
            picture = np.asarray(Image.open(file))
            assert (by_opencv == picture).all()
            stack[stem.rpartition("/")[2], t] = picture
    for t in range(NUM_FRAMES):
        assert_like(stack["combined", t], world.combined(t))
        layers = [world.layer(t, k) if t != LOST else np.zeros((120, 160, 4)) for k in range(2)]
        assert_like(stack["body", t], layers[0])
        assert_like(stack["arm", t], layers[1])
    assert not stack["combined", LOST].any()
    alpha = stack["arm", 0][..., 3]
    rim = (alpha == 0) & (cv2.dilate(alpha, np.ones((3, 3), np.uint8)) == 255)
    assert rim.any()
    assert (stack["arm", 0][rim][:, :3] == (40, 90, 200)).all()  # straight: no dark rim


def test_png_numbers_begin_where_asked(tmp_path, world):
    folder = export(world.animation, format_of("png"), tmp_path, Options(first_frame=1001))
    names = sorted(path.name for path in (folder / "combined").iterdir())
    assert (names[0], names[-1]) == ("combined.01001.png", f"combined.{1000 + NUM_FRAMES:05d}.png")


def decoded(path, decoder=None):
    """Read a video with alpha by FFmpeg: times, straight RGBA pictures, colour tags, rate and duration."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        codec = av.CodecContext.create(decoder, "r") if decoder else stream.codec_context
        frames = [frame for packet in container.demux(stream) for frame in codec.decode(packet)]
        tags = stream.codec_context
        found = (tags.colorspace, tags.color_range, tags.color_primaries, tags.color_trc)
        times = [frame.pts * stream.time_base for frame in frames]
        lasts = Fraction(container.duration, av.time_base)
        pictures = [
            frame.reformat(
                format="rgba", src_colorspace=Colorspace.ITU709, src_color_range=ColorRange.MPEG
            ).to_ndarray()
            for frame in frames
        ]
    return times, pictures, found, (stream.average_rate, lasts)


def test_prores_keeps_alpha_colour_and_exact_times(tmp_path, world):
    folder = export(world.animation, format_of("prores"), tmp_path)
    assert sorted(path.name for path in (folder / "layers").iterdir()) == ["arm.mov", "body.mov"]
    times, pictures, tags, (rate, lasts) = decoded(folder / "combined.mov")
    assert times == [t / FILM for t in range(NUM_FRAMES)]
    assert tags == (1, 1, 1, 1)
    assert rate == FILM
    assert abs(lasts - NUM_FRAMES / FILM) <= Fraction(1, 1000)
    for t, picture in enumerate(pictures):
        assert_like(picture, world.combined(t), PRORES_LEVELS, EDGE_SHARE)
    _, arms, _, _ = decoded(folder / "layers" / "arm.mov")
    assert_like(arms[3], world.layer(3, 1), PRORES_LEVELS, EDGE_SHARE)


def test_webm_keeps_alpha_in_the_stream_that_browsers_read(tmp_path, world):
    folder = export(world.animation, format_of("webm"), tmp_path)
    times, pictures, tags, (rate, lasts) = decoded(folder / "combined.webm", "libvpx-vp9")
    assert all(abs(time - t / FILM) <= Fraction(1, 1000) for t, time in enumerate(times))
    assert tags == (1, 1, 1, 1)
    assert rate == FILM
    assert abs(lasts - NUM_FRAMES / FILM) <= Fraction(1, 1000)
    assert len(pictures) == NUM_FRAMES
    for t, picture in enumerate(pictures):
        truth = world.combined(t)
        assert (np.abs(picture[..., 3] - truth[..., 3]) > WEBM_ALPHA_LEVELS).mean() <= EDGE_SHARE
        assert_like(picture, truth, WEBM_ALPHA_LEVELS, WEBM_SHARE)


def test_uneven_times_are_kept(tmp_path):
    pts = np.array([0, 1001, 3003, 4004, 9009, 10010, 11011, 15015])
    world = moving(pts=pts)
    times, _, _, _ = decoded(export(world.animation, format_of("prores"), tmp_path) / "layers" / "arm.mov")
    assert times == [Fraction(int(time), 24000) for time in pts]
