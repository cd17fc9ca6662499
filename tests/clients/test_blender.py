"""Blender reads our exports: tests/clients/install.sh, then python -m pytest -m clients."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.export.moving import BEHIND, FIRST, LOST, NUM_FRAMES, moving
from wildpuppet.export.draw import Painter
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of

pytestmark = pytest.mark.clients

HERE = Path(__file__).parent
PYTHON = Path(os.environ.get("WILDPUPPET_BLENDER", HERE / ".venv" / "bin" / "python"))
PIXELS = 1e-3
"""float32 of a hundredth of a pixel's coordinate, through Blender's matrices."""
UNITS = 0.01
LEVELS = 6.0
"""Grey levels of a ray-traced picture's filter and 8-bit rounding in sRGB."""
EDGE_SHARE = 0.004


@pytest.fixture(scope="module")
def world():
    return moving(pts=np.arange(NUM_FRAMES) * 1000)  # 24 frames per second, which Blender's scenes count in


@pytest.fixture(scope="module")
def exports(world, tmp_path_factory):
    out = tmp_path_factory.mktemp("exports")
    return {name: export(world.animation, format_of(name), out) for name in ("usd", "usdz", "glb", "exr", "mdd", "pc2")}


def blender(*words):
    if not PYTHON.is_file():
        pytest.skip("Blender's Python is not installed: tests/clients/install.sh")
    done = subprocess.run(
        [PYTHON, HERE / "blender.py", *map(str, words)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.parametrize(("name", "first"), [("usd", FIRST), ("usdz", FIRST), ("glb", 0)])
def test_every_vertex_in_every_frame(tmp_path, world, exports, name, first):
    file = next(exports[name].glob("puppet.*"))
    blender("play", file, first, NUM_FRAMES, 24, tmp_path / "played.npz")
    with np.load(tmp_path / "played.npz") as played:
        if name != "glb":
            assert played["scene"].tolist() == [24, FIRST, FIRST + NUM_FRAMES - 1]
        for t in range(NUM_FRAMES):
            truth, layers = world.vertices(t), world.puppet.layer_of_vertex
            for layer, part in enumerate(world.puppet.names):
                if t == LOST:
                    assert f"{part}|{t}" not in played or not np.ptp(played[f"{part}|{t}"], 0).any()
                    continue
                x, depth, up = played[f"{part}|{t}"].T / UNITS  # Blender's z is up
                found = np.column_stack([x, -up])
                assert np.abs(found - truth[layers == layer]).max() < PIXELS
                assert np.allclose(-depth, list(world.animation.order[t]).index(layer), atol=PIXELS)


@pytest.mark.parametrize("name", ["mdd", "pc2"])
def test_point_caches_move_every_vertex(tmp_path, world, exports, name):
    folder = exports[name]
    blender("cache", folder / "puppet.obj", folder / f"puppet.{name}", NUM_FRAMES, tmp_path / "played.npz")
    with np.load(tmp_path / "played.npz") as played:
        for t in range(NUM_FRAMES):
            x, _, up = played[str(t)].T / UNITS
            if t == LOST:
                assert not np.ptp(played[str(t)], 0).any()
            else:
                assert np.abs(np.column_stack([x, -up]) - world.vertices(t)).max() < PIXELS


@pytest.mark.parametrize(("name", "frame"), [("usd", FIRST + BEHIND), ("glb", BEHIND)])
def test_the_camera_shows_what_we_draw(tmp_path, world, exports, name, frame):
    width, height = world.animation.size
    blender("render", next(exports[name].glob("puppet.*")), frame, width, height, tmp_path / "seen.png")
    seen = np.asarray(Image.open(tmp_path / "seen.png")).astype(float)
    ours = Painter(world.animation).picture(world.animation[BEHIND]).astype(float)
    assert (np.abs(seen[..., 3] - ours[..., 3]) > 64).mean() < EDGE_SHARE
    inside = (ours[..., 3] == 255) & (seen[..., 3] == 255)
    assert inside.sum() > 1000
    assert (np.abs(seen - ours)[inside].max(-1) > LEVELS).mean() < EDGE_SHARE


def channels(path):
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels.copy() for name, channel in file.channels().items()}


def test_map_uv_draws_a_part(tmp_path, world, exports):
    folder = exports["exr"]
    st = folder / "st" / f"st.{FIRST + 3:05d}.exr"
    blender("map_uv", st, "arm", folder / "atlas.png", *world.animation.size, tmp_path / "arm.exr")
    seen, truth = channels(tmp_path / "arm.exr"), world.layer(3, 1)
    picture = np.stack([seen[side] for side in "RGBA"], -1) * 255
    solid = truth[..., 3] == 255
    assert (np.abs(picture - truth)[solid].max(-1) > 2.0).mean() < 0.01


def test_cryptomatte_is_picked_by_name(tmp_path, world, exports):
    path = exports["exr"] / "mattes" / f"mattes.{FIRST + BEHIND:05d}.exr"
    blender("matte", path, "arm", *world.animation.size, tmp_path / "matte.exr")
    found, truth = channels(tmp_path / "matte.exr")["R"], channels(path)["arm.A"]
    assert truth.max() == 1.0
    assert np.abs(found - truth).max() < 2e-3
