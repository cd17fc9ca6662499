"""The After Effects script: ECMAScript 3, and it builds the composition that the animation is.

After Effects itself cannot be run here: its objects are imitated, as its scripting guide describes them.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calmjs.parse import es5
from calmjs.parse.asttypes import FuncDecl, GetPropAssign, SetPropAssign
from calmjs.parse.walkers import Walker
from PIL import Image

from tests.export.edges import assert_runs_around_the_ink
from tests.export.moving import BEHIND, FIRST, HELD, LOST, NUM_FRAMES, SHOT, moving
from tests.node.client import require, run_node
from wildpuppet.export import aftereffects
from wildpuppet.export.draw import Painter
from wildpuppet.export.options import Options
from wildpuppet.machine import silent

PIXELS = 1e-3
UNEVEN = np.array([0, 800, 1600, 3600, 4400, 5200, 6000, 7200])
SECONDS = 1e-8


@pytest.fixture(scope="module")
def world():
    return moving(name='né "hero"\u2028')


@pytest.fixture(scope="module")
def script(tmp_path_factory, world):
    folder = tmp_path_factory.mktemp("ae")
    aftereffects.write(world.animation, folder, Options(), silent)
    return next(folder.glob("*.jsx"))


@pytest.fixture(scope="module")
def project(script):
    require("acorn")
    return run_node("aftereffects.mjs", str(script))


def test_a_parser_takes_it_and_nothing_in_it_is_newer_than_es3(script):
    text = script.read_text(encoding="ascii")
    tree = es5(text)
    assert sum(1 for node in Walker().walk(tree) if isinstance(node, FuncDecl)) == 6
    assert not any(isinstance(node, GetPropAssign | SetPropAssign) for node in Walker().walk(tree))
    for newer in (",]", ",}", ".forEach", ".map(", "JSON.", "Object.keys", ".trim(", ".bind("):
        assert newer not in text


def test_the_composition_is_the_clip(world, project):
    (comp,) = project["comps"]
    assert project["undo"] == 0
    assert (comp["name"], comp["width"], comp["height"]) == (world.animation.name, 160, 120)
    assert abs(comp["rate"] - 24000 / 1001) < 1e-9
    assert abs(comp["duration"] - NUM_FRAMES * 1001 / 24000) < SECONDS
    assert [marker[1]["comment"] for marker in comp["markerProperty"]["keys"]] == ["shot 1", "shot 2"]
    assert abs(comp["markerProperty"]["keys"][1][0] - SHOT * 1001 / 24000) < SECONDS


def test_parts_are_sequences_stacked_anew_where_the_order_changes(world, project):
    for layer, item in enumerate(project["footage"]):
        assert item["sequence"]
        assert item["mainSource"] == {"conformFrameRate": 24000 / 1001, "alphaMode": "STRAIGHT"}
        first = Path(item["file"])
        assert first.name == f"{world.puppet.names[layer]}.{FIRST:05d}.png"
        assert len(list(first.parent.iterdir())) == NUM_FRAMES
        shown = np.asarray(Image.open(first.with_name(first.name.replace(str(FIRST), str(FIRST + BEHIND)))))
        assert np.array_equal(shown, Painter(world.animation).picture(world.animation[BEHIND], layer))
    layers = [layer for layer in project["comps"][0]["list"] if not layer.get("isNull")][::-1]  # back to front
    assert len(layers) == 3
    for t, order in enumerate(world.animation.order):
        time = (t + 0.5) * 1001 / 24000
        shown = [layer["name"] for layer in layers if layer["inPoint"] <= time < layer["outPoint"]]
        assert shown == [world.puppet.names[k] for k in order]


def test_a_layer_that_is_used_again_is_hidden_between(tmp_path, world):
    order = np.array([[0, 1], [1, 0]] * (NUM_FRAMES // 2))
    aftereffects.write(replace(world.animation, order=order), tmp_path, Options(), silent)
    require("acorn")
    project = run_node("aftereffects.mjs", str(next(tmp_path.glob("*.jsx"))))
    layers = [layer for layer in project["comps"][0]["list"] if not layer.get("isNull")][::-1]
    assert len(layers) == 3
    for t in range(NUM_FRAMES):
        shown = []
        for layer in layers:
            keys = layer["children"].get("ADBE Transform Group", {}).get("children", {}).get("ADBE Opacity", {})
            earlier = [(value, kind) for time, value, kind in keys.get("keys", []) if frame_of(time) <= t]
            assert all(kind == "HOLD" for _, kind in earlier)
            if not keys or earlier[-1:] == [(100, "HOLD")]:
                shown.append(layer["name"])
        assert shown == [world.puppet.names[k] for k in order[t]]


def frame_of(time):
    return round(time * 24000 / 1001)


def test_masks_follow_the_outlines(world, project):
    puppet = world.puppet
    for layer in project["comps"][0]["list"]:
        if layer.get("isNull"):
            continue
        ((kind, mask),) = layer["children"]["ADBE Mask Parade"]["added"]
        assert (kind, mask["maskMode"]) == ("ADBE Mask Atom", "NONE")
        number = puppet.names.index(layer["name"])
        for time, shape, _ in mask["children"]["ADBE Mask Shape"]["keys"]:
            t = frame_of(time)
            if t != LOST:
                assert len(shape["vertices"]) == len(shape["inTangents"]) == len(shape["outTangents"])
                assert_runs_around_the_ink(world, t, number, shape["vertices"])


def test_nulls_are_the_hinges_and_cuts_are_held(world, project):
    (null,) = (layer for layer in project["comps"][0]["list"] if layer.get("isNull"))
    assert null["name"] == "body_to_arm"
    keys = null["children"]["ADBE Transform Group"]["children"]["ADBE Position"]["keys"]
    for time, place, kind in keys:
        t = frame_of(time)
        assert (kind == "HOLD") == (t in (SHOT - 1, NUM_FRAMES - 1))
        if t != LOST:
            corners = world.vertices(t)[world.puppet.joint_vertices[0]]
            middle = np.einsum("kcd,kc->kd", corners, world.puppet.joint_weights[0]).mean(0)
            assert np.abs(np.array(place) - middle).max() < PIXELS
    assert HELD in [frame_of(time) for time, _, _ in keys]  # the window moves on under the held drawing


def test_uneven_times_are_keyed_exactly_and_said(tmp_path):
    world = moving(pts=UNEVEN)
    manifest = aftereffects.write(world.animation, tmp_path, Options(), silent)
    assert any("uneven" in words for words in manifest.left_out)
    require("acorn")
    project = run_node("aftereffects.mjs", str(tmp_path / "hero_run.jsx"))
    (null,) = (layer for layer in project["comps"][0]["list"] if layer.get("isNull"))
    keys = null["children"]["ADBE Transform Group"]["children"]["ADBE Position"]["keys"]
    assert np.abs(np.array([key[0] for key in keys]) - UNEVEN / 24000).max() < SECONDS
