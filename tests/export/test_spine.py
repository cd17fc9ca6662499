"""Spine 4.2, evaluated after the published format (its runtimes need a licence and stay out of this project)."""

import json
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image

from tests.export.moving import HELD, LOST, SHOT, moving
from tests.export.spine_reader import Skeleton
from wildpuppet.export import spine
from wildpuppet.export.options import Options
from wildpuppet.export.rig import loops
from wildpuppet.machine import silent

PIXELS = 1e-3
"""Coordinates are written to 4 decimals, times to 6."""
TURN = 1e-4
"""Of a bone's axis, a millionth of a second after its key."""
UNEVEN = np.array([0, 800, 1600, 3600, 4400, 5200, 6000, 7200])


@pytest.mark.parametrize("pts", [None, UNEVEN])
def test_every_corner_texel_order_and_time_survives(tmp_path, pts):
    world = moving(pts=pts)
    puppet, height = world.puppet, world.animation.size[1]
    spine.write(world.animation, tmp_path, Options(), silent)
    read = Skeleton(tmp_path, "hero_run")
    assert np.array_equal(np.asarray(Image.open(tmp_path / read.page)), puppet.atlas)
    for t, frame in enumerate(world.animation):
        time = float(Fraction(int(UNEVEN[t]), 24000) if pts is not None else Fraction(1001 * t, 24000)) + 1e-6
        assert abs(time - float(frame.seconds)) < 1e-5
        assert read.order(time) == [puppet.names[layer] for layer in frame.order]
        for layer, name in enumerate(puppet.names):
            assert read.is_shown(name, time) == (t != LOST)
            places, texels, triangles = read.mesh(name, time)
            mine = np.flatnonzero(puppet.layer_of_vertex == layer)
            same = np.abs(texels[:, None] - puppet.uv[mine][None]).max(-1).argmin(1)  # which corner is which
            assert sorted(same) == list(range(len(mine)))
            assert np.abs(texels - puppet.uv[mine][same]).max() < PIXELS
            if t != LOST:
                expected = world.vertices(t)[mine][same] * (1, -1) + (0, height)
                assert np.abs(places - expected).max() < PIXELS
            ours = puppet.triangles[puppet.layer_of_triangle == layer]
            assert {frozenset(mine[same[corner]] for corner in each) for each in triangles} == {
                frozenset(each) for each in ours
            }
        if t != LOST:
            corners = world.vertices(t)[puppet.joint_vertices[0]]
            middle = np.einsum("kcd,kc->kd", corners, puppet.joint_weights[0]).mean(0)
            assert np.abs(read.world("arm", time)[:2, 2] - (middle * (1, -1) + (0, height))).max() < PIXELS
            for name, turned in zip(puppet.names, world.maps[t], strict=True):
                assert np.abs(read.world(name, time)[:2, 0] - turned[:, 0] * (1, -1)).max() < TURN


def test_held_drawings_and_cuts_are_stepped(tmp_path):
    world = moving()
    spine.write(world.animation, tmp_path, Options(), silent)
    tree = json.loads((tmp_path / "hero_run.json").read_text())
    ((_, motion),) = tree["animations"].items()
    deform = motion["attachments"]["default"]["arm"]["arm"]["deform"]
    frames = [round(key["time"] * 24000 / 1001) for key in deform]
    assert frames == [0, 1, 3, 5, 6, 7]  # 2 repeats 1 and is held; 4 is lost and hidden
    stepped = [frame for frame, key in zip(frames, deform, strict=True) if key.get("curve") == "stepped"]
    assert stepped == [HELD - 1, LOST - 1, SHOT - 1, 7]
    assert [(event["int"], round(event["time"] * 24000 / 1001)) for event in motion["events"]] == [(1, 0), (2, SHOT)]


def test_the_outline_comes_first_and_in_order(tmp_path):
    world = moving()
    spine.write(world.animation, tmp_path, Options(), silent)
    tree = json.loads((tmp_path / "hero_run.json").read_text())
    mesh = tree["skins"][0]["attachments"]["body"]["body"]
    corners = np.array(mesh["vertices"]).reshape(-1, 2)[: mesh["hull"]]
    assert mesh["hull"] == 16
    steps = np.linalg.norm(corners - np.roll(corners, 1, 0), axis=1)
    assert steps.max() <= 17.0  # neighbours on the grid, all the way around


def test_outlines_are_chained_also_where_they_touch():
    ring = np.array([[0, 1], [1, 2], [2, 0], [5, 6], [6, 7], [7, 8], [8, 5]])
    assert [sorted(loop) for loop in loops(ring)] == [[5, 6, 7, 8], [0, 1, 2]]
    eight = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [3, 4], [4, 0]])
    assert sorted(loops(eight)[0]) == [0, 1, 2, 3, 4]
