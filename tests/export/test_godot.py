"""The Godot scene, read by the godot_parser package. Godot 4 itself cannot be run here."""

import numpy as np
import pytest
from godot_parser import parse
from PIL import Image

from tests.export.moving import HELD, LOST, NUM_FRAMES, SHOT, moving
from wildpuppet.export import godot
from wildpuppet.export.options import Options
from wildpuppet.machine import silent

PIXELS = 1e-3
UNEVEN = np.array([0, 800, 1600, 3600, 4400, 5200, 6000, 7200])


def pairs(vectors):
    return np.array(vectors.args, float).reshape(-1, 2)


class Player:
    """Plays value tracks as Godot does: a key with transition 0 is held, others glide."""

    def __init__(self, path):
        self.sections = list(parse(path.read_text(encoding="utf-8")).get_sections())
        self.nodes = {s.header.attributes["name"]: s for s in self.sections if s.header.name == "node"}
        library = next(s for s in self.sections if s.header.attributes.get("type") == "AnimationLibrary")
        self.names = list(library["_data"])
        self.resources = {s.header.attributes["id"]: s for s in self.sections if s.header.name == "sub_resource"}

    def tracks(self, name):
        body = self.resources[f"Animation_{name}"].properties
        count = sum(1 for key in body if key.endswith("/path"))
        return {body[f"tracks/{i}/path"].path: body[f"tracks/{i}/keys"] for i in range(count)}

    def value(self, keys, time, read):
        times, glides = np.array(keys["times"].args, float), keys["transitions"].args
        place = max(int(np.searchsorted(times, time, "right")) - 1, 0)
        here = read(keys["values"][place])
        if keys["update"] == 1 or place + 1 == len(times) or glides[place] == 0:
            return here
        share = max((time - times[place]) / (times[place + 1] - times[place]), 0.0)
        return here + (read(keys["values"][place + 1]) - here) * share


def transform(value):
    return np.array(value.args, float).reshape(3, 2)


@pytest.mark.parametrize("pts", [None, UNEVEN])
def test_corners_texels_order_and_times_survive(tmp_path, pts):
    world = moving(pts=pts)
    puppet, animation = world.puppet, world.animation
    godot.write(animation, tmp_path, Options(), silent)
    player = Player(tmp_path / "hero_run.tscn")
    assert player.names == ["hero_run_shot1", "hero_run_shot2"]
    assert np.array_equal(np.asarray(Image.open(tmp_path / "hero_run.png")), puppet.atlas)
    for t, frame in enumerate(animation):
        tracks = player.tracks(player.names[t >= SHOT])
        time = float(frame.seconds - animation.timing.seconds(SHOT if t >= SHOT else 0)) + 1e-6
        window = player.value(tracks["Window:transform"], time, transform)
        assert player.value(tracks["Window:visible"], time, bool) == (t != LOST)
        ranks = [player.value(tracks[f"Window/{name}:z_index"], time, int) for name in puppet.names]
        assert np.argsort(ranks).tolist() == frame.order.tolist()
        for layer, name in enumerate(puppet.names):
            mine = np.flatnonzero(puppet.layer_of_vertex == layer)
            texels = pairs(player.nodes[name]["uv"])
            same = np.abs(texels[:, None] - puppet.uv[mine][None]).max(-1).argmin(1)
            assert np.abs(texels - puppet.uv[mine][same]).max() < PIXELS
            own = player.value(tracks[f"Window/{name}:polygon"], time, pairs)
            if t != LOST:
                assert np.abs(own @ window[:2] + window[2] - world.vertices(t)[mine][same]).max() < PIXELS
            faces = {frozenset(mine[same[i]] for i in each.args) for each in player.nodes[name]["polygons"]}
            assert faces == {frozenset(f) for f in puppet.triangles[puppet.layer_of_triangle == layer]}
            assert player.nodes[name]["internal_vertex_count"] == len(mine) - 16
        if t != LOST:
            corners = world.vertices(t)[puppet.joint_vertices[0]]
            middle = np.einsum("kcd,kc->kd", corners, puppet.joint_weights[0]).mean(0)
            place = player.value(tracks["Window/body_to_arm:position"], time, lambda v: np.array([v.x, v.y], float))
            assert np.abs(place @ window[:2] + window[2] - middle).max() < PIXELS


def test_held_drawings_are_held(tmp_path):
    world = moving()
    godot.write(world.animation, tmp_path, Options(), silent)
    player = Player(tmp_path / "hero_run.tscn")
    keys = player.tracks("hero_run_shot1")["Window/arm:polygon"]
    frames = np.rint(np.array(keys["times"].args, float) * 24000 / 1001).astype(int).tolist()
    assert frames == [0, 1, 3, 5]
    assert list(keys["transitions"].args) == [1, 0, 0, 0]
    between = (HELD - 0.5) * 1001 / 24000
    assert np.array_equal(player.value(keys, between, pairs), pairs(keys["values"][1]))
    assert len(player.tracks("hero_run_shot2")["Window/arm:polygon"]["values"]) == NUM_FRAMES - SHOT


def test_the_scene_refers_to_what_is_there(tmp_path):
    world = moving()
    godot.write(world.animation, tmp_path, Options(), silent)
    text = (tmp_path / "hero_run.tscn").read_text()
    player = Player(tmp_path / "hero_run.tscn")
    assert text.startswith(f"[gd_scene load_steps={len(player.resources) + 2} format=3]")
    paths = {path.split(":")[0] for name in player.names for path in player.tracks(name)}
    known = {
        "/".join(filter(None, [s.header.attributes.get("parent", "").strip("."), name]))
        for name, s in player.nodes.items()
    }
    assert paths <= known
