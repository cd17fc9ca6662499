import shutil

import numpy as np
import psd_tools
import pytest
from PIL import Image

from tests.correspond import scene
from tests.paint.film import PAINT, spot_mask, with_spot
from wildpuppet.errors import InputError
from wildpuppet.export.sprites import merged, over_white, sprites_at_rest
from wildpuppet.paint.reading import Origin, read_edit
from wildpuppet.paint.template import cutout_of, write_template
from wildpuppet.paint.texture import canvas_pictures
from wildpuppet.puppet.build import build
from wildpuppet.puppet.folder import read_cutout, write_cutout
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import CutOut, Part

SHAPE = (scene.CANVAS[1], scene.CANVAS[0])


@pytest.fixture
def puppet():
    return scene.puppet()


def assert_spotted(edit, puppet):
    """The very texels of the spot changed, and no others."""
    expected = with_spot(puppet)
    assert edit.parts == ("arm",)
    assert not edit.erases
    assert (edit.puppet.atlas == expected.puppet.atlas).all()
    assert (edit.puppet.atlas != puppet.atlas).any(-1).sum() > 80


def with_spot_on(path):
    picture = np.array(Image.open(path))
    picture[spot_mask(SHAPE)] = (*PAINT, 255)
    Image.fromarray(picture).save(path)


def test_a_folder_of_parts_comes_back(puppet, tmp_path):
    write_template(puppet, tmp_path / "paint")
    with pytest.raises(InputError, match="nothing differs"):
        read_edit(tmp_path / "paint", puppet)
    with_spot_on(tmp_path / "paint" / "parts" / "arm.png")
    assert_spotted(read_edit(tmp_path / "paint", puppet), puppet)
    (tmp_path / "only").mkdir()
    shutil.copy(tmp_path / "paint" / "parts" / "arm.png", tmp_path / "only")
    assert_spotted(read_edit(tmp_path / "only", puppet), puppet)


@pytest.mark.parametrize("suffix", [".psd", ".ora"])
def test_a_layered_file_comes_back_unedited(puppet, suffix, tmp_path):
    write_template(puppet, tmp_path / f"paint{suffix}")
    with pytest.raises(InputError, match="nothing differs"):
        read_edit(tmp_path / f"paint{suffix}", puppet)


def test_a_psd_that_another_program_saved_comes_back(puppet, tmp_path):
    write_template(puppet, tmp_path / "paint.psd")
    layers = {layer.name: layer for layer in psd_tools.PSDImage.open(tmp_path / "paint.psd")}
    saved = psd_tools.PSDImage.new("RGBA", puppet.canvas)
    for name, layer in layers.items():
        picture = layer.topil()
        canvas = Image.new("RGBA", puppet.canvas)
        canvas.paste(picture, (layer.left, layer.top))
        pixels = np.array(canvas)
        if name == "arm":
            pixels[spot_mask(SHAPE)] = (*PAINT, 255)
        saved.append(saved.create_pixel_layer(Image.fromarray(pixels), name=name))
    saved.save(tmp_path / "edited.psd")
    assert_spotted(read_edit(tmp_path / "edited.psd", puppet), puppet)
    saved[0].name = "Layer 3"
    saved.save(tmp_path / "other.psd")
    with pytest.raises(InputError, match=r"layer 'Layer 3' is no part of the puppet \(parts: body, arm\); rename it"):
        read_edit(tmp_path / "other.psd", puppet)


@pytest.mark.parametrize("kind", ["rest", "on white", "atlas", "frame"])
def test_one_flat_picture_goes_to_the_front_most_part(puppet, kind, tmp_path):
    flat = merged(puppet.canvas, sprites_at_rest(puppet))
    ground = np.full((*SHAPE, 3), (90, 120, 90), np.uint8)
    share = flat[..., 3:] / 255.0
    frame = np.rint(flat[..., :3] * share + ground * (1.0 - share)).astype(np.uint8)
    picture = {"rest": flat, "on white": over_white(flat), "atlas": puppet.atlas, "frame": frame}[kind].copy()
    spot = spot_mask(SHAPE)
    if kind == "atlas":
        left, top = (puppet.uv - puppet.vertices)[puppet.layer_of_vertex == 1][0].astype(int)
        rows, columns = np.nonzero(spot)
        picture[rows + top, columns + left, :3] = PAINT
    else:
        picture[spot, :3] = PAINT
    Image.fromarray(picture).save(tmp_path / "edited.png")
    assert_spotted(read_edit(tmp_path / "edited.png", puppet, Origin(None, lambda: frame)), puppet)


def test_paint_beside_the_parts_is_told(puppet, tmp_path):
    flat = merged(puppet.canvas, sprites_at_rest(puppet))
    flat[spot_mask(SHAPE)] = (*PAINT, 255)
    flat[:10, :10] = (*PAINT, 255)
    Image.fromarray(flat).save(tmp_path / "edited.png")
    assert read_edit(tmp_path / "edited.png", puppet).notes == ("100 painted pixels lie on no part and are left out",)
    write_template(puppet, tmp_path / "paint")
    path = tmp_path / "paint" / "parts" / "arm.png"
    with_spot_on(path)
    picture = np.array(Image.open(path))
    picture[:5, :5] = 255
    Image.fromarray(picture).save(path)
    edit = read_edit(tmp_path / "paint", puppet)
    assert edit.notes == ("arm: 25 painted pixels lie beyond the part's mesh and are left out",)


def test_the_puppet_folder_that_was_given_is_known(tmp_path):
    """Building bleeds colours and cleans edges; an untouched copy of the folder must not count as edited."""
    y, x = np.mgrid[:90, :120] + 0.5
    distance = np.hypot(x - 60, y - 45) - 30
    alpha = np.clip(0.5 - distance, 0, 1) * 255
    rgba = np.dstack([x * 2, y * 2, 0 * x + 90, alpha]).astype(np.uint8)
    rgba[5:8, 5:8] = (10, 200, 10, 255)  # a speck that building drops
    cutout = CutOut((120, 90), (Part("ball", rgba),))
    built = build(cutout, PuppetSettings())
    write_cutout(cutout, tmp_path / "given")
    origin = Origin(read_cutout(tmp_path / "given"))
    with pytest.raises(InputError, match="nothing differs"):
        read_edit(tmp_path / "given", built, origin)
    path = tmp_path / "given" / "parts" / "ball.png"
    picture = np.array(Image.open(path))
    picture[40:50, 55:65, :3] = PAINT
    Image.fromarray(picture).save(path)
    edit = read_edit(tmp_path / "given", built, origin)
    after = canvas_pictures(edit.puppet)["ball"]
    changed = (after != canvas_pictures(built)["ball"]).any(-1)
    assert changed[40:50, 55:65].all()
    assert changed.sum() == 100


def test_colour_is_bled_beyond_a_painted_edge(tmp_path):
    """Texels with no alpha mix into the rim when they are sampled: they take the new colour."""
    puppet = scene.puppet()
    write_template(puppet, tmp_path / "paint")
    path = tmp_path / "paint" / "parts" / "arm.png"
    picture = np.array(Image.open(path))
    picture[picture[..., 3] > 0, :3] = PAINT
    Image.fromarray(picture).save(path)
    atlas = read_edit(tmp_path / "paint", puppet).puppet.atlas
    uv = puppet.uv[puppet.layer_of_vertex == 1].astype(int)
    mine = atlas[uv[:, 1].min() : uv[:, 1].max(), uv[:, 0].min() : uv[:, 0].max()]
    assert (mine[..., 3] == 0).any()
    assert (mine[..., :3] == PAINT).all()


def test_what_does_not_fit_is_refused_in_words(puppet, tmp_path):
    with pytest.raises(InputError, match="found nothing"):
        read_edit(tmp_path / "absent.png", puppet)
    Image.new("RGBA", (33, 44)).save(tmp_path / "small.png")
    with pytest.raises(
        InputError, match=r"is 33 x 44; expected the picture of the puppet at rest or its atlas, .*160 x"
    ):
        read_edit(tmp_path / "small.png", puppet)
    write_template(puppet, tmp_path / "paint")
    parts = tmp_path / "bare"
    shutil.copytree(tmp_path / "paint" / "parts", parts)
    (parts / "arm.png").rename(parts / "leg.png")
    with pytest.raises(InputError, match=r"leg.png: no part has this name; expected body.png, arm.png"):
        read_edit(parts, puppet)
    Image.new("RGBA", (10, 10)).save(parts / "leg.png")
    (parts / "leg.png").rename(parts / "arm.png")
    with pytest.raises(InputError, match=r"arm.png: is 10 x 10, the puppet's canvas is 160 x 120"):
        read_edit(parts, puppet)
    Image.new("RGB", puppet.canvas).save(parts / "arm.png")
    with pytest.raises(InputError, match="has no transparency"):
        read_edit(parts, puppet)
    with pytest.raises(InputError, match="already exists"):
        write_template(puppet, tmp_path / "paint")
    with pytest.raises(InputError, match=r"expected a folder or a name that ends with .psd or .ora"):
        write_template(puppet, tmp_path / "paint.tiff")


def test_a_template_is_a_puppet(tmp_path):
    puppet = build(cutout_of(scene.puppet()), PuppetSettings())
    assert puppet.names == ("body", "arm")
    assert puppet.canvas == scene.CANVAS
