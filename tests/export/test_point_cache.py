"""MDD and PC2, read by struct after their published layouts, with the OBJ read by trimesh."""

import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.export.moving import FIRST, LOST, NUM_FRAMES, moving
from wildpuppet.export import mdd, pc2
from wildpuppet.export.options import Options
from wildpuppet.export.pieces import GAP
from wildpuppet.machine import silent

UNITS = 0.01
PIXELS = 1e-3
UNEVEN = np.array([0, 800, 1600, 3600, 4400, 5200, 6000, 7200])


def read_mdd(path):
    data = path.read_bytes()
    frames, points = struct.unpack_from(">ii", data)
    times = struct.unpack_from(f">{frames}f", data, 8)
    floats = struct.unpack_from(f">{frames * points * 3}f", data, 8 + 4 * frames)
    assert len(data) == 8 + 4 * frames + 12 * frames * points
    return np.array(times), np.array(floats).reshape(frames, points, 3)


def read_pc2(path):
    data = path.read_bytes()
    signature, version, points, start, rate, samples = struct.unpack_from("<12siiffi", data)
    assert (signature, version, rate) == (b"POINTCACHE2\0", 1, 1.0)
    assert len(data) == 32 + 12 * samples * points
    return start, np.frombuffer(data, "<f4", offset=32).reshape(samples, points, 3)


@pytest.mark.parametrize("writer", [mdd, pc2])
def test_points_times_order_and_the_obj_agree(tmp_path, writer):
    world = moving(pts=UNEVEN)
    puppet = world.puppet
    manifest = writer.write(world.animation, tmp_path, Options(units_per_pixel=UNITS), silent)
    if writer is mdd:
        times, positions = read_mdd(tmp_path / "puppet.mdd")
        assert np.abs(times - UNEVEN / 24000).max() < 1e-6
    else:
        start, positions = read_pc2(tmp_path / "puppet.pc2")
        assert start == FIRST
        assert any("uneven" in words for words in manifest.left_out)
    for t in range(NUM_FRAMES):
        if t == LOST:
            assert np.ptp(positions[t], axis=0).max() == 0.0
            continue
        assert np.abs(positions[t, :, :2] - world.vertices(t) * (UNITS, -UNITS)).max() < PIXELS * UNITS
        rank = np.argsort(world.animation.order[t])[puppet.layer_of_vertex]
        assert np.abs(positions[t, :, 2] - rank * GAP * UNITS).max() < PIXELS * UNITS
    assert any(str(FIRST + LOST) in words for words in manifest.left_out)
    assert manifest.error.largest < PIXELS
    shape = trimesh.load(tmp_path / "puppet.obj", process=False, maintain_order=True)
    assert np.abs(shape.vertices - positions[0]).max() < 1e-6
    corners = shape.vertices[shape.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()
    texels = shape.visual.uv * (1, -1) * puppet.atlas.shape[1::-1] + (0, puppet.atlas.shape[0])
    assert np.abs(texels - puppet.uv).max() < PIXELS
    assert np.array_equal(np.asarray(Image.open(tmp_path / "atlas.png")), puppet.atlas)
