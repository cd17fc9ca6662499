"""DragonBones: the published runtime plays the files, and what it shows is what we have."""

import json

import numpy as np
import pytest
from PIL import Image

from tests.export.moving import FIRST, HELD, LOST, SHOT, moving
from tests.node.client import require, run_node
from wildpuppet.errors import InputError
from wildpuppet.export import dragonbones
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.options import Options
from wildpuppet.machine import silent

PIXELS = 1e-3
"""Coordinates are written to 4 decimals and played in 32-bit floats."""
LARGE_PIXELS = 1e-2
"""The same for coordinates of thousands of pixels."""


def played(folder, stem="hero_run"):
    require("@cocos/dragonbones-js")
    return run_node("dragonbones.mjs", str(folder), stem)


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


def test_bones_are_the_hinges(world, tree):
    puppet = world.puppet
    for t, frame in enumerate(frames_of(tree)):
        corners = world.vertices(t if t != LOST else LOST - 1)[puppet.joint_vertices[0]]
        if t != LOST:
            middle = np.einsum("kcd,kc->kd", corners, puppet.joint_weights[0]).mean(0)
            assert np.abs(np.array(frame["bones"]["body_to_arm"]) - middle).max() < PIXELS


def test_a_held_drawing_is_stepped_and_others_glide(world, tree):
    between = frames_of(tree, "between")

    def body(t, frames):
        return np.array(frames[t]["meshes"]["body"]["vertices"])

    exact = frames_of(tree)
    held = (body(HELD - 1, exact) + body(HELD, exact)) / 2  # the window glides under the drawing
    assert np.abs(body(HELD - 1, between) - held).max() < PIXELS
    glide = (body(0, exact) + body(1, exact)) / 2
    assert np.abs(body(0, between) - glide).max() < PIXELS
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


def test_long_clips_are_cut_where_the_runtimes_numbers_end(tmp_path):
    long = moving(1300)
    dragonbones.write(long.animation, tmp_path, Options(), silent)
    tree = played(tmp_path)
    assert len(tree["animations"]) == 3  # two shots, the second one too long for 16 bits
    frames = frames_of(tree)
    for t in (0, 5, 640, 652, 653, 660, 1299):
        mine = long.puppet.layer_of_vertex == 1
        expected = long.vertices(t)[mine]
        assert np.abs(np.array(frames[t]["meshes"]["arm"]["vertices"]) - expected).max() < LARGE_PIXELS


def test_a_mesh_that_the_format_cannot_number_is_refused(tmp_path, world, monkeypatch):
    monkeypatch.setattr(dragonbones, "MOST_CORNERS", 49)
    with pytest.raises(InputError, match="49 mesh corners, found 50"):
        dragonbones.write(world.animation, tmp_path, Options(), silent)
