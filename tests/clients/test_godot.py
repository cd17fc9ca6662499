"""Godot 4's own engine plays an exported scene: its web build in Chromium, tests/clients/install.sh."""

import base64
import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.clients.browser import page
from tests.clients.godot import write_project
from tests.clients.test_browser import assert_like
from tests.export.moving import FILM, LOST, NUM_FRAMES, SHOT, moving
from wildpuppet.export.draw import Painter
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of

pytestmark = pytest.mark.clients

ENGINE = Path(os.environ.get("WILDPUPPET_GODOT", Path(__file__).parent / ".godot" / "package" / "godot"))
PIXELS = 2e-3


def moment(t):
    """Animation and time of a frame, a hair after its key."""
    start, name = (SHOT, "hero_run_shot2") if t >= SHOT else (0, "hero_run_shot1")
    return [name, round(float((t - start) / FILM), 6) + 1e-6]


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def played(world, tmp_path_factory):
    if not (ENGINE / "index.wasm").is_file():
        pytest.skip("Godot's web build is not installed: tests/clients/install.sh")
    folder = tmp_path_factory.mktemp("godot")
    files = export(world.animation, format_of("godot"), folder / "out")
    write_project(folder, ENGINE, files, world.animation.size, [moment(t) for t in range(NUM_FRAMES)])
    found = page(folder, "index.html", folder / "profile")
    assert "error" not in found, found
    return found


def test_every_vertex_in_every_frame(world, played):
    assert str(played["version"]).startswith("4.")
    for t, seen in enumerate(played["found"]):
        assert seen["visible"] == (t != LOST)
        if t == LOST:
            continue
        order = world.animation.order[t].tolist()
        for layer, name in enumerate(world.puppet.names):
            truth = world.vertices(t)[world.puppet.layer_of_vertex == layer]
            found = np.array(seen["nodes"][name]["places"])
            assert seen["nodes"][name]["z"] == order.index(layer)
            distance = np.linalg.norm(found[:, None] - truth[None], axis=-1)
            assert distance.min(0).max() < PIXELS
            assert distance.min(1).max() < PIXELS


def test_animations_last_as_long_as_their_shots(played):
    lengths = played["lengths"]
    assert lengths["hero_run_shot1"] == pytest.approx(float(SHOT / FILM), abs=1e-4)
    assert lengths["hero_run_shot2"] == pytest.approx(float((NUM_FRAMES - SHOT) / FILM), abs=1e-4)


def test_what_is_drawn_is_what_we_draw(world, played):
    painter = Painter(world.animation)
    for t, seen in enumerate(played["found"]):
        picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(seen["picture"])))).astype(float)
        if t == LOST:
            assert not picture[..., 3].any()
        else:
            assert_like(picture, painter.picture(world.animation[t]).astype(float), 4, 0.03)
