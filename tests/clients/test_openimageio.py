"""OpenImageIO reads EXR exports: st_warp draws the parts, channels and Cryptomatte's notes are there."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.clients.test_blender import channels
from tests.export.moving import FILM, FIRST, moving
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of

pytestmark = pytest.mark.clients

HERE = Path(__file__).parent
PYTHON = Path(os.environ.get("WILDPUPPET_OPENIMAGEIO", HERE / ".oiio" / "bin" / "python"))
LEVELS = 2.0
EDGE_SHARE = 0.004


def openimageio(*words):
    if not PYTHON.is_file():
        pytest.skip("OpenImageIO is not installed: tests/clients/install.sh")
    done = subprocess.run(
        [PYTHON, HERE / "openimageio.py", *map(str, words)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def folder(world, tmp_path_factory):
    return export(world.animation, format_of("exr"), tmp_path_factory.mktemp("exr"))


def test_st_warp_draws_every_part(tmp_path, world, folder):
    for t in (0, 3, 7):
        maps = folder / "st" / f"st.{FIRST + t:05d}.exr"
        for layer, part in enumerate(world.puppet.names):
            out = tmp_path / f"{part}{t}.exr"
            openimageio("st_warp", folder / "atlas.png", maps, f"{part}.U,{part}.V", *world.animation.size, out)
            seen, truth = channels(out), world.layer(t, layer)
            picture = np.stack([seen[side] for side in "RGBA"], -1) * 255
            picture[channels(maps)[f"{part}.A"] == 0] = 0
            assert (np.abs(picture - truth).max(-1) > LEVELS).mean() < EDGE_SHARE


def test_what_the_files_say_of_themselves(folder):
    told = json.loads(openimageio("info", folder / "mattes" / f"mattes.{FIRST:05d}.exr"))
    assert told["format"] == "float"
    assert {"body.A", "arm.A"} <= set(told["channels"])
    assert any(key.startswith("cryptomatte/") and key.endswith("/manifest") for key in told["said"])
    (rate,) = (value for key, value in told["said"].items() if key.lower() == "framespersecond")
    rate = rate.strip("()").replace("/", ",").split(",")
    assert [int(number) for number in rate] == [FILM.numerator, FILM.denominator]
    motion = json.loads(openimageio("info", folder / "motion" / f"motion.{FIRST:05d}.exr"))
    assert set(motion["channels"]) == {"forward.u", "forward.v", "backward.u", "backward.v", "confidence"}
