"""Files that Krita and Inkscape wrote are imported: system packages krita, inkscape, xvfb, then pytest -m clients."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.puppet.imports.drawings import ARM, SIZE, TORSO, assert_same_picture, random_picture
from tests.puppet.imports.test_ora import PICTURES, png, saved
from wildpuppet.puppet.imports.formats import read_puppet
from wildpuppet.puppet.imports.from_frame import drawn_svg

pytestmark = pytest.mark.clients


def run(*words: object) -> None:
    """Run a program on a display of its own."""
    missing = [name for name in ("xvfb-run", str(words[0])) if shutil.which(name) is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)}: not installed")
    subprocess.run(["xvfb-run", "-a", *map(str, words)], check=True, capture_output=True, timeout=300)


@pytest.fixture(scope="module")
def layered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    stack = """<stack>
      <layer name="sketch" src="data/arm.png" visibility="hidden" />
      <stack name="limb" opacity="0.5"><layer name="arm" src="data/arm.png" x="50" y="20" opacity="0.4" /></stack>
      <layer name="torso" src="data/torso.png" x="20" y="15" /><layer name="Paper" src="data/paper.png" />
    </stack>"""
    paper = png(random_picture(9, *SIZE, alpha=255))
    return saved(tmp_path_factory.mktemp("layered"), stack, {**PICTURES, "data/paper.png": paper})


@pytest.mark.parametrize("kind", ["psd", "ora"])
def test_krita_writes_layers_that_come_back_to_the_pixel(layered: Path, tmp_path: Path, kind: str) -> None:
    written = tmp_path / f"figure.{kind}"
    run("krita", layered, "--export", "--export-filename", written)
    found = read_puppet(written)
    torso, arm = found.cutout.parts
    assert (torso.name, arm.name) == ("torso", "arm")
    assert_same_picture(torso.rgba, TORSO.on_canvas())
    expected = ARM.on_canvas()
    # Krita keeps opacities in 255ths, rounded down: 127 and 101.
    assert np.abs(arm.rgba[..., 3] - expected[..., 3] * (127 / 255) * (101.5 / 255)).max() <= 1.5
    seen = expected[..., 3] > 0
    assert np.array_equal(arm.rgba[seen][:, :3], expected[seen][:, :3])
    assert {"'sketch' is hidden and left out"} <= set(found.notes)
    assert any("'Paper' covers the whole canvas" in note for note in found.notes)


def test_inkscape_writes_outlines_that_come_back(tmp_path: Path) -> None:
    Image.fromarray(random_picture(1, 200, 100)[..., :3]).save(tmp_path / "frame.png")
    (tmp_path / "drawn.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="50mm" height="25mm" viewBox="0 0 50 25">'
        '<image style="display:none" width="50" height="25" xlink:href="frame.png"/>'
        '<g inkscape:groupmode="layer" inkscape:label="Layer 1" transform="translate(1 2) rotate(5)">'
        '<path inkscape:label="torso" d="M 5 5 C 20 0 30 10 28 15 S 8 20 5 5 Z"/>'
        '<ellipse inkscape:label="arm" cx="30" cy="10" rx="8" ry="3" transform="rotate(20 30 10)"/>'
        '<circle inkscape:label="torso+arm" cx="26" cy="9" r="1"/></g></svg>'
    )
    before = drawn_svg(tmp_path / "drawn.svg", None)
    run("inkscape", tmp_path / "drawn.svg", "--export-filename", tmp_path / "written.svg")
    after = drawn_svg(tmp_path / "written.svg", None)
    assert np.array_equal(after.rgb, before.rgb)
    assert [part.name for part in after.outlines.parts] == ["torso", "arm"]
    for old, new in zip(before.outlines.parts, after.outlines.parts, strict=True):
        assert np.abs(new.coverage((200, 100)) - old.coverage((200, 100))).max() < 0.02
    (joint,) = after.outlines.joints
    assert joint.parts == ("torso", "arm")
    assert joint.at == pytest.approx(before.outlines.joints[0].at, abs=0.01)
