"""MLT splines and EbSynth guides against a puppet whose motion is known. Neither program can be run here."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.correspond import scene
from tests.export.edges import assert_runs_around_the_ink
from tests.export.moving import FIRST, HELD, LOST, NUM_FRAMES, moving
from wildpuppet.export import ebsynth, mlt
from wildpuppet.export.options import Options
from wildpuppet.export.outlines import edge_of, outlines
from wildpuppet.geometry.affine import apply, invert
from wildpuppet.machine import silent


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def project(tmp_path_factory, world):
    folder = tmp_path_factory.mktemp("mlt")
    named = replace(world.puppet, names=("body", "a<r&m\x02"))
    mlt.write(replace(world.animation, puppet=named), folder, Options(), silent)
    return ElementTree.parse(folder / "hero_run.mlt").getroot()


def properties(element):
    return {child.get("name"): child.text for child in element.findall("property")}


def polygon(keys, t):
    """An MLT spline in frame t: straight between its keys."""
    frames = np.array(sorted(int(key) for key in keys))
    values = np.array([np.array(keys[str(frame)])[:, 1] for frame in frames])
    place = np.clip(np.searchsorted(frames, t, "right") - 1, 0, len(frames) - 2)
    share = np.clip((t - frames[place]) / (frames[place + 1] - frames[place]), 0, 1)
    return (values[place] * (1 - share) + values[place + 1] * share) * (160, 120)


def test_splines_cut_the_parts_out_of_every_frame(world, project):
    profile = project.find("profile")
    assert (profile.get("frame_rate_num"), profile.get("frame_rate_den")) == ("24000", "1001")
    for layer in range(2):
        producer = project.find(f"./producer[@id='part{layer}']")
        assert properties(producer)["kdenlive:clipname"] == ("body", "a<r&m?")[layer]
        (spline,) = (properties(made) for made in producer.findall("filter"))
        assert (spline["mlt_service"], spline["alpha_operation"]) == ("rotoscoping", "clear")
        keys = json.loads(spline["spline"])
        for t in set(range(NUM_FRAMES)) - {LOST}:
            assert_runs_around_the_ink(world, t, layer, polygon(keys, t))
        handles = np.array(keys["0"])
        assert np.array_equal(handles[:, 0], handles[:, 1])
        assert np.array_equal(handles[:, 2], handles[:, 1])


def test_tracks_show_the_parts_in_order_and_nothing_where_the_character_is_lost(world, project):
    first, *names = (track.get("producer") for track in project.findall("./tractor/track"))
    assert first == "under"
    tracks = []
    for name in names:
        shown = []
        for item in project.find(f"./playlist[@id='{name}']"):
            if item.tag == "blank":
                shown += [None] * int(item.get("length"))
            else:
                assert int(item.get("in")) == len(shown)  # the spline's frames are the timeline's
                shown += [int(item.get("producer").removeprefix("part"))] * (int(item.get("out")) - len(shown) + 1)
        assert len(shown) == NUM_FRAMES
        tracks.append(shown)
    for t, order in enumerate(world.animation.order.tolist()):
        assert [track[t] for track in tracks if track[t] is not None] == ([] if t == LOST else order)
    blends = [properties(each) for each in project.findall("./tractor/transition")]
    assert [(each["a_track"], each["b_track"]) for each in blends] == [("0", "1"), ("0", "2"), ("0", "3")]


def test_a_held_spline_stands_still(world):
    still = replace(world.animation, video_from_crop=np.repeat(world.animation.video_from_crop[:1], NUM_FRAMES, 0))
    keys = json.loads(mlt.spline(still, outlines(world.puppet, 0)[0]))
    assert keys[str(HELD - 1)] == keys[str(HELD)]
    assert np.array_equal(polygon(keys, HELD - 0.5), polygon(keys, HELD))


def test_edges_pass_over_holes_and_specks():
    y, x = np.mgrid[:60, :80] + 0.5
    radius = np.hypot(x - 30.5, y - 30.5)
    alpha = np.rint(np.clip(np.minimum(20.5 - radius, radius - 7.5), 0, 1) * 255).astype(np.uint8)
    cv2.rectangle(alpha, (60, 20), (70, 40), 255, -1)
    alpha[5, 75] = 255
    round_one, square = edge_of(alpha)
    assert np.abs(np.hypot(*(round_one - 30.5).T) - 20).max() < 0.1  # its corners lie on the edge
    assert np.abs(np.ptp(square, axis=0) - (11, 21)).max() < 0.01
    assert edge_of(np.zeros((4, 4), np.uint8)) == []


def test_guides_say_where_on_the_puppet_each_pixel_is(tmp_path, world):
    ebsynth.write(world.animation, tmp_path, Options(), silent)
    for t in range(NUM_FRAMES):
        guide = np.asarray(Image.open(tmp_path / "guide" / f"guide.{FIRST + t:05d}.png"))
        mask = np.asarray(Image.open(tmp_path / "mask" / f"mask.{FIRST + t:05d}.png"))
        assert ((guide[..., 2] > 0) != (mask > 127)).mean() < 0.002
        if t == LOST:
            assert not mask.any()
            continue
        for layer in range(2):
            rows, columns = np.nonzero(guide[..., 2] == (128, 255)[layer])
            assert len(rows) > 500
            canvas = apply(invert(world.maps[t, layer]), np.stack([columns, rows], 1) + 0.5)
            assert np.abs(guide[rows, columns, :2] - canvas / scene.CANVAS * 255).max() < 0.51
