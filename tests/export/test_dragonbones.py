"""DragonBones: the published runtime plays the files, and what it shows is what we have."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image

from tests.export.moving import FIRST, HELD, LOST, NUM_FRAMES, SHOT, moving
from tests.node.client import require, run_node
from wildpuppet.errors import InputError
from wildpuppet.export import dragonbones
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.options import Options
from wildpuppet.export.timing import timing_of
from wildpuppet.geometry.affine import apply, similarity
from wildpuppet.machine import silent

PIXELS = 1e-3
"""Coordinates are written to 4 decimals and played in 32-bit floats."""
TURN = 1e-6
"""Of a bone's axis: turns are written to millionths of a degree, sizes to 8 decimals."""


def played(folder, stride=1):
    require("@cocos/dragonbones-js")
    return run_node("dragonbones.mjs", str(folder), "hero_run", str(stride))


def frames_of(tree, kind="frames"):
    return [frame for animation in tree["animations"] for frame in animation[kind]]


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def tree(tmp_path_factory, world):
    return played(export(world.animation, format_of("dragonbones"), tmp_path_factory.mktemp("out")))


def test_the_runtime_shows_every_corner_texel_and_order(world, tree):
    puppet = world.puppet
    for t, frame in enumerate(frames_of(tree)):
        assert frame["shown"] == [t != LOST] * 2
        assert frame["order"] == [puppet.names[layer] for layer in world.animation.order[t]]
        for layer, name in enumerate(puppet.names) if t != LOST else ():
            mine = puppet.layer_of_vertex == layer
            mesh = frame["meshes"][name]
            assert np.abs(np.array(mesh["vertices"]) - world.vertices(t)[mine]).max() < PIXELS
            assert np.abs(np.array(mesh["uv"]) - puppet.uv[mine]).max() < PIXELS
            triangles = np.flatnonzero(mine)[np.array(mesh["triangles"]).reshape(-1, 3)]
            assert np.array_equal(triangles, puppet.triangles[puppet.layer_of_triangle == layer])


def test_bones_hang_on_the_hinges_and_turn_with_their_parts(world, tree):
    puppet = world.puppet
    for t, frame in enumerate(frames_of(tree)):
        if t == LOST:
            continue
        corners = world.vertices(t)[puppet.joint_vertices[0]]
        hinge = np.einsum("kcd,kc->kd", corners, puppet.joint_weights[0]).mean(0)
        assert np.abs(np.array(frame["bones"]["arm"][:2]) - hinge).max() < PIXELS
        for name, turned in zip(puppet.names, world.maps[t], strict=True):
            assert np.abs(np.array(frame["bones"][name][2:]) - turned[:, 0]).max() < TURN


def test_a_held_drawing_is_stepped_and_others_glide(world, tree):
    between = frames_of(tree, "between")

    def body(t, frames):
        return np.array(frames[t]["meshes"]["body"]["vertices"])

    exact = frames_of(tree)
    held = (body(HELD - 1, exact) + body(HELD, exact)) / 2  # the window glides under the drawing
    assert np.abs(body(HELD - 1, between) - held).max() < PIXELS
    rest = world.puppet.vertices[world.puppet.layer_of_vertex == 0]
    first, second = (world.vertices(t)[world.puppet.layer_of_vertex == 0].mean(0) for t in (0, 1))
    half_way = similarity(np.array(1.01), np.array(0.025), (first + second) / 2)  # it turns, not shrinks, on the way
    assert np.abs(body(0, between) - apply(half_way, rest - rest.mean(0))).max() < PIXELS
    assert np.abs(body(SHOT - 1, between) - body(SHOT - 1, exact)).max() < PIXELS  # nothing glides over a cut


def test_shots_are_animations_and_the_manifest_says_what_is_lost(tmp_path, world, tree):
    assert [each["name"] for each in tree["animations"]] == ["hero run_shot1", "hero run_shot2"]
    folder = export(world.animation, format_of("dragonbones"), tmp_path)
    said = json.loads((folder / "manifest.json").read_text())
    assert any("24000/1001 is written as 24" in words for words in said["left_out"])
    assert any(f"frames {FIRST + SHOT} to {FIRST + 7}" in words for words in said["left_out"])
    assert np.array_equal(np.asarray(Image.open(folder / "hero_run_tex.png")), world.puppet.atlas)
    again = export(world.animation, format_of("dragonbones"), tmp_path / "again")
    assert all((again / file.name).read_bytes() == file.read_bytes() for file in folder.iterdir())


def test_long_clips_are_cut_where_the_runtimes_numbers_end(tmp_path, world):
    again = np.arange(1300) % NUM_FRAMES
    names = ("vertices_crop", "video_from_crop", "order", "confidence")
    arrays = {name: getattr(world.animation, name)[again] for name in names}
    arrays |= {"frames": np.arange(1300), "shot": np.zeros(1300, np.int64)}
    state = tuple(world.animation.state[t] for t in again)
    times = timing_of(1300, (np.arange(1300) * 1001, Fraction(1, 24000)))
    dragonbones.write(replace(world.animation, **arrays, state=state, timing=times), tmp_path, Options(), silent)
    stride = 13
    tree = played(tmp_path, stride)
    assert [each["length"] for each in tree["animations"]] == [650, 650]  # too long for 16 bits
    for first, each in zip((0, 650), tree["animations"], strict=True):
        for place, frame in enumerate(each["frames"]):
            t = again[first + place * stride]
            for layer, name in enumerate(world.puppet.names) if t != LOST else ():
                expected = world.vertices(t)[world.puppet.layer_of_vertex == layer]
                assert np.abs(np.array(frame["meshes"][name]["vertices"]) - expected).max() < PIXELS


def test_a_mesh_that_the_format_cannot_number_is_refused(tmp_path, world, monkeypatch):
    monkeypatch.setattr(dragonbones, "MOST_CORNERS", 49)
    with pytest.raises(InputError, match="49 mesh corners, found 50"):
        dragonbones.write(world.animation, tmp_path, Options(), silent)
