"""EXR: the OpenEXR library reads the files, and OpenCV's remap through the ST maps draws what the parts look like."""

import json
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from tests.export.moving import BEHIND, FILM, FIRST, LOST, NUM_FRAMES, SHOT, moving
from wildpuppet.export import cryptomatte
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.geometry.affine import apply, compose, invert

OpenEXR = pytest.importorskip("OpenEXR")

LEVELS = 1.5
"""Grey levels between two bilinear samplers."""
EDGE_SHARE = 0.002
"""Share of pixels at mesh borders, where alpha 0 is cut a texel earlier than OpenCV's."""
MOTION_PIXELS = 2e-3
SEEN = 0.02


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def folder(world, tmp_path_factory):
    return export(world.animation, format_of("exr"), tmp_path_factory.mktemp("exr"))


def read(folder, kind, t):
    file = OpenEXR.File(str(folder / kind / f"{kind}.{FIRST + t:05d}.exr"), separate_channels=True)
    return {name: channel.pixels for name, channel in file.channels().items()}, file.header()


def premultiplied_atlas(world):
    atlas = world.puppet.atlas.astype(np.float32)
    atlas[..., :3] *= atlas[..., 3:] / 255.0
    return atlas


def painted(world, u, v, alpha):
    """Sample the atlas as compositors do: v upwards, pixel centres at half, weighted by the map's alpha."""
    atlas = premultiplied_atlas(world)
    height, width = atlas.shape[:2]
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    picture = cv2.remap(atlas, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    return picture * (alpha[..., None] > 0)


def test_st_maps_draw_every_part_and_the_whole(world, folder):
    for t in (0, 3, BEHIND, 7):
        channels, header = read(folder, "st", t)
        assert header["framesPerSecond"] == FILM
        assert {pixels.dtype for pixels in channels.values()} == {np.dtype(np.float32)}
        for layer, part in enumerate(world.puppet.names):
            u, v, a = (channels[f"{part}.{side}"] for side in "UVA")
            truth = world.layer(t, layer)
            assert (np.abs(painted(world, u, v, a) - truth).max(-1) > LEVELS).mean() <= EDGE_SHARE
            assert (np.abs(a * 255 - truth[..., 3]) > LEVELS).mean() <= EDGE_SHARE
        whole = world.combined(t)
        assert (np.abs(channels["A"] * 255 - whole[..., 3]) > LEVELS).mean() <= EDGE_SHARE
        both = painted(world, channels["R"], channels["G"], channels["A"])
        inside = cv2.erode(whole[..., 3], np.ones((5, 5))) == 255
        behind = np.abs(both - whole).max(-1)[inside] > LEVELS
        assert behind.mean() < SEEN  # only where the two parts' edges mix


def test_a_lost_frame_is_empty_and_is_there(folder):
    for kind in ("st", "motion", "mattes"):
        channels, _ = read(folder, kind, LOST)
        assert not any(pixels.any() for pixels in channels.values())


def test_motion_leads_to_where_the_surface_goes(world, folder):
    y, x = np.mgrid[:120, :160] + 0.5
    here = np.stack([x, y], -1).reshape(-1, 2)
    for t, is_forward in ((0, True), (1, True), (2, False), (7, False)):
        channels, _ = read(folder, "motion", t)
        name, other = ("forward", t + 1) if is_forward else ("backward", t - 1)
        found = np.stack([channels[f"{name}.u"], -channels[f"{name}.v"]], -1)
        front, back = world.animation.order[t][::-1]
        covered = np.zeros((120, 160), bool)
        for layer in (front, back):
            inside = cv2.erode(world.layer(t, layer)[..., 3], np.ones((5, 5))) == 255
            there = apply(compose(world.maps[other, layer], invert(world.maps[t, layer])), here)
            truth = (there - here).reshape(120, 160, 2)
            chosen = inside & ~covered
            assert chosen.sum() > 200
            assert np.abs(found - truth)[chosen].max() < MOTION_PIXELS
            covered |= world.layer(t, layer)[..., 3] > 0


def test_how_sure_the_seen_surface_is(tmp_path, world):
    layers, vertices = world.puppet.layer_of_vertex, world.puppet.vertices
    sure = np.where(layers == 1, (vertices[:, 0] - 86.0) / 58.0, 0.25)
    animation = replace(world.animation, confidence=np.tile(sure, (NUM_FRAMES, 1)))
    channels, _ = read(export(animation, format_of("exr"), tmp_path), "motion", 0)
    x = np.mgrid[:120, :160][1] + 0.5
    arm = cv2.erode(world.layer(0, 1)[..., 3], np.ones((3, 3))) == 255
    body = (cv2.erode(world.layer(0, 0)[..., 3], np.ones((3, 3))) == 255) & (world.layer(0, 1)[..., 3] == 0)
    assert np.abs(channels["confidence"] - (x - 86.0) / 58.0)[arm].max() < 1e-4
    assert np.abs(channels["confidence"] - 0.25)[body].max() < 1e-6
    assert not channels["confidence"][world.combined(0)[..., 3] == 0].any()


def test_no_motion_across_cuts_ends_and_lost_frames(folder):
    for t, name in ((0, "backward"), (NUM_FRAMES - 1, "forward"), (LOST - 1, "forward"), (SHOT, "backward")):
        channels, _ = read(folder, "motion", t)
        assert not channels[f"{name}.u"].any()
        assert not channels[f"{name}.v"].any()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("hello", 0x248BFA47),
        ("hello, world", 0x149BBB7F),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_hashes_are_murmurs(text, expected):
    assert cryptomatte.murmur3(text) == expected


def test_mattes_are_picked_by_name(world, folder):
    t = BEHIND
    channels, header = read(folder, "mattes", t)
    (key,) = [key.removesuffix("/name") for key in header if key.endswith("/name")]
    assert (header[f"{key}/hash"], header[f"{key}/conversion"]) == ("MurmurHash3_32", "uint32_to_float32")
    assert len(key.removeprefix("cryptomatte/")) == 7
    names, layer_name = json.loads(header[f"{key}/manifest"]), header[f"{key}/name"]
    assert set(names) == {"body", "arm"}
    ranks = [(channels[f"{layer_name}{k:02d}.{i}"], channels[f"{layer_name}{k:02d}.{c}"]) for k in range(3) for i, c in
             (("R", "G"), ("B", "A"))]  # fmt: skip
    assert all((a >= b).all() for (_, a), (_, b) in pairwise(ranks))
    body = world.layer(t, 0)[..., 3] / 255.0
    arm = world.layer(t, 1)[..., 3] / 255.0 * (1 - body)  # the arm is behind here
    for name, truth in (("body", body), ("arm", arm)):
        wanted = np.array(int(names[name], 16), np.uint32).view(np.float32)
        matte = sum(np.where(ids == wanted, coverage, 0) for ids, coverage in ranks)
        assert (np.abs(matte - truth) * 255 > LEVELS).mean() <= EDGE_SHARE
        assert np.array_equal(matte, channels[f"{name}.A"])
        assert matte.max() == 1.0
