"""melt, the player of Kdenlive's and Shotcut's projects, plays an export: packages melt and xvfb of the system."""

import shutil
import subprocess

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.export.moving import LOST, NUM_FRAMES, moving
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.palette import colour_of

pytestmark = pytest.mark.clients

CORNERS = 3
"""Pixels that may lie farther from the edge than one: MLT fills whole pixels, and rounds the splines' corners."""


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def played(world, tmp_path_factory):
    """Every frame that melt draws, straight RGBA."""
    missing = [name for name in ("xvfb-run", "melt") if shutil.which(name) is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)}: not installed")
    folder = tmp_path_factory.mktemp("melt")
    (project,) = export(world.animation, format_of("mlt"), folder / "out").glob("*.mlt")
    words = ["xvfb-run", "-a", "melt", str(project), "-consumer", f"avformat:{folder}/%05d.png"]
    how = ["vcodec=png", "pix_fmt=rgba", "mlt_image_format=rgba", "f=image2", "real_time=-1", "threads=1"]
    subprocess.run([*words, *how], check=True, capture_output=True, timeout=300)
    return [np.asarray(Image.open(path).convert("RGBA")).astype(float) for path in sorted(folder.glob("*.png"))]


def assert_same_area(found, truth):
    """Alike but for the pixels along the edge."""
    near = np.ones((3, 3), np.uint8)
    inside, outside = (cv2.erode(each.astype(np.uint8), near) > 0 for each in (truth, ~truth))
    assert (inside & ~found).sum() + (outside & found).sum() <= CORNERS


def test_melt_cuts_every_part_out_of_every_frame(world, played):
    assert len(played) == NUM_FRAMES
    for t, picture in enumerate(played):
        alpha = world.combined(t)[..., 3]
        assert picture.shape[:2] == alpha.shape
        if t == LOST:
            assert not picture[..., 3].any()
            continue
        assert_same_area(picture[..., 3] > 127, alpha > 127)
        seen = np.full(alpha.shape, -1)
        for layer in world.animation.order[t]:
            seen[world.layer(t, int(layer))[..., 3] > 127] = layer
        for layer in range(2):
            mine = np.abs(picture[..., :3] - colour_of(layer)).max(-1) < 12
            assert_same_area(mine & (picture[..., 3] > 127), seen == layer)
