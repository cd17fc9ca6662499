"""Blender's Mesh Cache modifier plays MDD and PC2 on the OBJ beside them."""

import subprocess

import numpy as np
import pytest

from tests.clients.test_blender import HERE, PYTHON
from tests.export.moving import LOST, NUM_FRAMES, moving
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.options import Options

pytestmark = pytest.mark.clients

PIXELS = 1e-3
UNITS = 0.01


@pytest.mark.parametrize("name", ["mdd", "pc2"])
def test_every_corner_in_every_frame(tmp_path, name):
    if not PYTHON.is_file():
        pytest.skip("Blender's Python is not installed: tests/clients/install.sh")
    world = moving()
    folder = export(world.animation, format_of(name), tmp_path, Options(first_frame=0, units_per_pixel=UNITS))
    out = tmp_path / "played.npz"
    words = [PYTHON, HERE / "blender_cache.py", folder / "puppet.obj", folder / f"puppet.{name}", NUM_FRAMES, out]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    with np.load(out) as played:
        for t in set(range(NUM_FRAMES)) - {LOST}:
            assert np.abs(played["corners"][t, :, :2] - world.vertices(t) * (UNITS, -UNITS)).max() < PIXELS * UNITS
        height, width = world.puppet.atlas.shape[:2]
        texels = (played["uv"] * (1, -1) + (0, 1)) * (width, height)
        assert np.abs(texels - world.puppet.uv).max() < PIXELS
        assert played["image"].tolist() == [width, height]
