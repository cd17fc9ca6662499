"""Krita opens layered exports: the merged picture, and each layer's name, place and pixels after it saved them."""

import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from tests.export.moving import FIRST, moving
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of
from wildpuppet.export.options import Options
from wildpuppet.export.sprites import merged, sprites_in_frame
from wildpuppet.puppet.imports.formats import read_puppet

pytestmark = pytest.mark.clients

SHOWN = 3


def krita(source, target):
    missing = [name for name in ("xvfb-run", "krita") if shutil.which(name) is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)}: not installed")
    words = ["xvfb-run", "-a", "krita", source, "--export", "--export-filename", target]
    subprocess.run(list(map(str, words)), check=True, capture_output=True, timeout=300)


@pytest.mark.parametrize("kind", ["psd", "ora"])
def test_krita_shows_what_was_exported(tmp_path, kind):
    world = moving()
    folder = export(world.animation, format_of(kind), tmp_path / "out", Options(picture_frame=FIRST + SHOWN))
    (file,) = folder.glob(f"*.{kind}")
    sprites = sprites_in_frame(world.animation, SHOWN)
    krita(file, tmp_path / "seen.png")
    seen = np.asarray(Image.open(tmp_path / "seen.png").convert("RGBA")).astype(int)
    ours = merged(world.animation.size, sprites).astype(int)
    assert np.abs(seen[..., 3] - ours[..., 3]).max() <= 1
    drawn = ours[..., 3] > 32
    assert np.abs(seen - ours)[drawn][:, :3].max() <= 3
    other = "ora" if kind == "psd" else "psd"
    krita(file, tmp_path / f"again.{other}")
    parts = read_puppet(tmp_path / f"again.{other}").cutout.parts
    assert [part.name for part in parts] == [sprite.name for sprite in sprites]
    for part, sprite in zip(parts, sprites, strict=True):
        height, width = sprite.rgba.shape[:2]
        place = part.rgba[sprite.top : sprite.top + height, sprite.left : sprite.left + width]
        assert (place[..., 3] == sprite.rgba[..., 3]).all()
        shown = sprite.rgba[..., 3] > 0
        assert (place[shown] == sprite.rgba[shown]).all()
