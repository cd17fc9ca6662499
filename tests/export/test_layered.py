"""PSD and ORA: layers, names, order and places as other programs' libraries read them."""

import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from psd_tools import PSDImage

from tests.correspond import scene
from tests.export.moving import BEHIND, LOST, moving
from wildpuppet.errors import InputError
from wildpuppet.export import ora, psd
from wildpuppet.export.options import Options
from wildpuppet.export.sprites import Sprite, sprites_in_frame
from wildpuppet.machine import silent
from wildpuppet.puppet.imports.formats import read_puppet

SIZE = (160, 120)
ROUNDING = 2
"""8-bit steps: two roundings of straight colour over one another."""


def art(width, height, seed):
    rng = np.random.default_rng(seed)
    rgba = rng.integers(0, 256, (height, width, 4), np.uint8)
    rgba[: height // 2, 1 : width - 1] = (9, 8, 7, 255)  # long runs
    rgba[0, 0] = (0, 0, 0, 0)
    return rgba


@pytest.fixture
def sprites():
    return [
        Sprite("körper", art(301, 21, 0), -5, 100),
        Sprite("手" * 40, art(9, 300, 1), 50, -10),
        Sprite('a<b & "c"\x01', art(1, 1, 2), 159, 119),
        Sprite("gone", np.zeros((1, 1, 4), np.uint8), 0, 0),
    ]


def composed(sprites):
    """Pillow's own compositing of the layers."""
    whole = Image.new("RGBA", SIZE)
    for sprite in sprites:
        layer = Image.new("RGBA", SIZE)
        layer.paste(Image.fromarray(sprite.rgba), (sprite.left, sprite.top))
        whole = Image.alpha_composite(whole, layer)
    return np.asarray(whole)


def assert_alike(found, expected):
    shown = expected[..., 3] > 128
    assert np.abs(found[..., 3].astype(int) - expected[..., 3]).max() <= ROUNDING
    assert np.abs(found.astype(int) - expected)[shown].max() <= ROUNDING


def test_psd_tools_reads_every_layer_to_the_bit(tmp_path, sprites):
    file = tmp_path / "layers.psd"
    psd.write_psd(file, SIZE, sprites)
    document = PSDImage.open(file)
    assert document.size == SIZE
    assert [layer.name for layer in document] == [sprite.name for sprite in sprites]
    for layer, sprite in zip(document, sprites, strict=True):
        assert (layer.left, layer.top) == (sprite.left, sprite.top)
        assert layer.visible
        assert layer.opacity == 255
        assert np.array_equal(np.asarray(layer.topil()), sprite.rgba)
    assert_alike(np.asarray(document.composite(force=True)), composed(sprites))
    assert_alike(np.asarray(document.topil()), composed(sprites))  # the merged picture, without layers
    viewer = Image.open(file)
    alpha = np.asarray(viewer)[..., 3:] / 255.0
    on_white = composed(sprites)[..., :3] * alpha + 255.0 * (1.0 - alpha)
    assert np.abs(np.asarray(viewer)[..., :3] - on_white).max() <= ROUNDING


def test_ora_is_as_the_specification_asks(tmp_path, sprites):
    file = tmp_path / "layers.ora"
    ora.write_ora(file, SIZE, sprites)
    assert file.read_bytes()[30:54] == b"mimetypeimage/openraster"  # a stored first member, for `file` and friends
    archive = zipfile.ZipFile(file)
    stack = ElementTree.fromstring(archive.read("stack.xml"))
    assert (stack.get("w"), stack.get("h")) == ("160", "120")
    layers = stack.findall("./stack/layer")[::-1]
    assert [layer.get("name") for layer in layers] == ["körper", "手" * 40, 'a<b & "c"?', "gone"]
    for layer, sprite in zip(layers, sprites, strict=True):
        assert (int(layer.get("x")), int(layer.get("y"))) == (sprite.left, sprite.top)
        assert np.array_equal(np.asarray(Image.open(archive.open(layer.get("src")))), sprite.rgba)
    assert_alike(np.asarray(Image.open(archive.open("mergedimage.png"))), composed(sprites))
    assert max(Image.open(archive.open("Thumbnails/thumbnail.png")).size) <= 256
    ora.write_ora(tmp_path / "again.ora", SIZE, sprites)
    assert (tmp_path / "again.ora").read_bytes() == file.read_bytes()


def test_a_run_becomes_its_parts_at_rest_exactly(tmp_path):
    animation = moving().animation
    manifest = psd.write(animation, tmp_path, Options(), silent)
    document = PSDImage.open(tmp_path / "hero_run.psd")
    assert document.size == scene.CANVAS
    assert manifest.first_frame == 0
    assert "no motion" in manifest.left_out[1]
    for layer, (x, y, w, h), name, colour in zip(
        document, (scene.BODY, scene.ARM), ("body", "arm"), ((200, 60, 40), (40, 90, 200)), strict=True
    ):
        assert (layer.name, *layer.bbox) == (name, x, y, x + w, y + h)
        assert (np.asarray(layer.topil()) == (*colour, 255)).all()


@pytest.mark.parametrize("writer", [psd, ora])
def test_our_own_import_reads_the_parts_back(tmp_path, writer):
    writer.write(moving().animation, tmp_path, Options(), silent)
    cutout = read_puppet(next(tmp_path.iterdir())).cutout
    assert cutout.canvas == scene.CANVAS
    for part, (x, y, w, h), name, colour in zip(
        cutout.parts, (scene.BODY, scene.ARM), ("body", "arm"), ((200, 60, 40), (40, 90, 200)), strict=True
    ):
        assert part.name == name
        assert (part.rgba[y : y + h, x : x + w] == (*colour, 255)).all()
        assert (part.rgba[..., 3] > 0).sum() == w * h


def test_a_frame_has_the_parts_where_they_are_in_the_order_of_that_frame(tmp_path):
    animation = moving().animation
    ora.write(animation, tmp_path, Options(picture_frame=100 + BEHIND), silent)
    stack = ElementTree.fromstring(zipfile.ZipFile(tmp_path / "hero_run.ora").read("stack.xml"))
    assert [layer.get("name") for layer in stack.iter("layer")] == ["body", "arm"]  # topmost first
    first = sprites_in_frame(animation, 0)
    left, top, width, height = scene.BODY
    box = (first[0].left, first[0].top, *first[0].rgba.shape[1::-1])
    assert np.abs(np.subtract(box, (left, top, width, height))).max() <= 1
    middle = first[0].rgba[height // 2, width // 2]
    assert np.abs(middle.astype(int) - (200, 60, 40, 255)).max() <= 1


@pytest.mark.parametrize(("number", "words"), [(99, "100 to 107"), (100 + LOST, "lost")])
def test_frames_that_cannot_be_shown_are_refused_in_words(tmp_path, number, words):
    with pytest.raises(InputError, match=words):
        psd.write(moving().animation, tmp_path, Options(picture_frame=number), silent)


def test_a_canvas_that_psd_cannot_hold_is_refused(tmp_path):
    animation = moving().animation
    wide = replace(animation, puppet=replace(animation.puppet, canvas=(30001, 10)))
    with pytest.raises(InputError, match="export ORA"):
        psd.write(wide, tmp_path, Options(), silent)
