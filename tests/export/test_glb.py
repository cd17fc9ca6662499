"""GLB: pygltflib reads the file, Khronos's validator finds nothing, three.js plays it where the vertices are."""

import io
import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pygltflib
import pytest
from PIL import Image

from tests.correspond import scene
from tests.export.moving import BEHIND, FILM, HELD, LOST, NUM_FRAMES, moving
from tests.node.client import require, run_node
from wildpuppet.export import glb
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.holds import holds_of, motion_between
from wildpuppet.geometry.affine import apply, similarity

PIXELS = 2e-3
"""float32 of a hundredth of a pixel's coordinate, through a node's map."""
UNITS = 0.01
TYPES = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def folder(world, tmp_path_factory):
    return export(world.animation, format_of("glb"), tmp_path_factory.mktemp("glb"))


@pytest.fixture(scope="module")
def gltf(folder):
    return pygltflib.GLTF2().load(folder / "puppet.glb")


def array(gltf, number):
    accessor = gltf.accessors[number]
    view = gltf.bufferViews[accessor.bufferView]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    flat = np.frombuffer(
        gltf.binary_blob(), TYPES[accessor.componentType], accessor.count * WIDTHS[accessor.type], start
    )
    return flat.reshape(accessor.count, -1)


def nodes_named(gltf, name):
    return [number for number, node in enumerate(gltf.nodes) if node.name == name]


def sampler_of(gltf, node, path):
    for channel in gltf.animations[0].channels:
        if (channel.target.node, channel.target.path) == (node, path):
            return gltf.animations[0].samplers[channel.sampler]
    return None


def test_bounds_weights_and_steps_keep_the_rules(gltf):
    for number, accessor in enumerate(gltf.accessors):
        if accessor.max:
            values = array(gltf, number)
            assert values.min(0).tolist() == accessor.min
            assert values.max(0).tolist() == accessor.max
    for sampler in gltf.animations[0].samplers:
        assert sampler.interpolation == "STEP"
        times = array(gltf, sampler.input)[:, 0]
        assert (np.diff(times) > 0).all()
        assert times[-1] == pytest.approx(NUM_FRAMES / float(FILM))
        assert all(float(time) <= t / FILM for time in times for t in [round(float(time) * float(FILM))])
    (arm,) = nodes_named(gltf, "arm")
    weights = array(gltf, sampler_of(gltf, arm, "weights").output)
    assert set(np.unique(weights)) == {0.0, 1.0}


def test_a_held_drawing_is_one_target_and_no_key(world, gltf):
    (arm,) = nodes_named(gltf, "arm")
    mesh = gltf.meshes[gltf.nodes[arm].mesh]
    assert len(mesh.primitives[0].targets) == NUM_FRAMES - 2
    frames = [number for number in range(101, 100 + NUM_FRAMES) if number != 100 + HELD]
    assert mesh.extras["targetNames"] == [f"frame {number}" for number in frames]
    times = array(gltf, sampler_of(gltf, arm, "weights").input)[:, 0]
    shown_at = [round(float(time) * float(FILM)) for time in times]
    assert shown_at == [t for t in range(NUM_FRAMES + 1) if t != HELD]
    (window,) = nodes_named(gltf, "Window")
    moved_at = array(gltf, sampler_of(gltf, window, "translation").input)[:, 0]
    assert np.rint(moved_at * float(FILM)).tolist() == [0, HELD, HELD + 1, NUM_FRAMES]


def test_look_is_the_atlas_unlit(world, gltf):
    image = gltf.images[0]
    view = gltf.bufferViews[image.bufferView]
    png = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    assert (np.asarray(Image.open(io.BytesIO(png))) == world.puppet.atlas).all()
    assert gltf.materials[0].alphaMode == "BLEND"
    assert "KHR_materials_unlit" in gltf.extensionsUsed
    height, width = world.puppet.atlas.shape[:2]
    for layer, part in enumerate(world.puppet.names):
        primitive = gltf.meshes[gltf.nodes[nodes_named(gltf, part)[0]].mesh].primitives[0]
        uv = array(gltf, primitive.attributes.TEXCOORD_0) * (width, height)
        assert np.allclose(uv, world.puppet.uv[world.puppet.layer_of_vertex == layer], atol=1e-4)
        places = array(gltf, primitive.attributes.POSITION)
        a, b, c = (places[array(gltf, primitive.indices).reshape(-1, 3)[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def played(folder, seconds):
    require("three")
    return run_node("glb.mjs", str(folder / "puppet.glb"), *(f"{second:.9f}" for second in seconds))


def assert_where_they_are(shown, world, t):
    truth, layers = world.vertices(t), world.puppet.layer_of_vertex
    for layer, part in enumerate(world.puppet.names):
        found = np.array(next(points for name, points in shown.items() if name.split("_")[0] == part))
        assert np.abs(found[:, :2] / (UNITS, -UNITS) - truth[layers == layer]).max() < PIXELS
        assert np.allclose(found[:, 2] / UNITS, list(world.animation.order[t]).index(layer), atol=1e-3)


def test_three_js_plays_every_frame_and_the_validator_is_content(world, folder):
    exact, before_the_next = ([(t + share) / float(FILM) for t in range(NUM_FRAMES)] for share in (1e-6, 0.99))
    tree = played(folder, [*exact, *before_the_next])
    assert (tree["issues"]["numErrors"], tree["issues"]["numWarnings"]) == (0, 0)
    for place, shown in enumerate(tree["times"]):
        t = place % NUM_FRAMES
        if t == LOST:
            assert shown == {}
        else:
            assert_where_they_are(shown, world, t)
    assert tree["weights"] == [0, 1]
    assert tree["materials"] == ["MeshBasicMaterial transparent true sides 2"]
    width, height = (side * UNITS / 2 for side in scene.CANVAS)
    assert tree["cameras"][0][:6] == pytest.approx([-width, width, height, -height, width, -height])
    assert BEHIND < NUM_FRAMES  # the arm goes behind within the clip, so depths were told apart


def test_long_clips_are_spread_over_meshes_that_browsers_take(tmp_path, world, monkeypatch):
    monkeypatch.setattr(glb, "MOST_TARGETS", 3)
    folder = export(world.animation, format_of("glb"), tmp_path)
    gltf = pygltflib.GLTF2().load(folder / "puppet.glb")
    assert max(len(mesh.primitives[0].targets or ()) for mesh in gltf.meshes) == 2
    seen = [t for t in range(NUM_FRAMES) if t != LOST]
    tree = played(folder, [(t + 0.5) / float(FILM) for t in seen])
    assert tree["issues"]["numErrors"] == 0
    for t, shown in zip(seen, tree["times"], strict=True):
        assert len(shown) == world.puppet.num_layers
        assert_where_they_are(shown, world, t)


def test_uneven_times_are_kept(tmp_path):
    pts = np.array([0, 1001, 3003, 4004, 9009, 10010, 11011, 15015])
    world = moving(pts=pts)
    gltf = pygltflib.GLTF2().load(export(world.animation, format_of("glb"), tmp_path) / "puppet.glb")
    sampler = sampler_of(gltf, nodes_named(gltf, "arm")[0], "weights")
    exact = [float(Fraction(int(time), 24000)) for t, time in enumerate(pts) if t != HELD]
    assert array(gltf, sampler.input)[:-1, 0] == pytest.approx(exact, abs=1e-6)


def test_one_frame_has_no_animation(tmp_path):
    world = moving(1)
    folder = export(world.animation, format_of("glb"), tmp_path)
    gltf = pygltflib.GLTF2().load(folder / "puppet.glb")
    assert not gltf.animations
    assert json.loads((folder / "manifest.json").read_text())["error"]["largest"] < PIXELS


def test_a_held_drawing_may_turn_and_zoom_but_not_bend(world):
    base = world.vertices(1)
    moved = apply(similarity(np.array(1.02), np.array(0.03), np.array([3.0, -2.0])), base)
    assert np.abs(apply(motion_between(base, moved), base) - moved).max() < 1e-9
    assert motion_between(base, moved + np.sin(base) * 0.01) is None
    assert motion_between(np.zeros((4, 2)), np.ones((4, 2))) is None
    animation = replace(world.animation, video_from_crop=world.animation.video_from_crop.copy())
    animation.video_from_crop[HELD] = similarity(np.array(0.7), np.array(0.1), np.array([2.0, 9.0]))
    holds = holds_of(animation)
    assert holds.drawing.tolist() == [0, 1, 1, 2, 3, 4, 5, 6]
    moved = apply(holds.moved[HELD], animation.vertices(1))
    assert np.abs(moved - animation.vertices(HELD)).max() < 1e-9
