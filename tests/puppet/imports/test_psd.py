"""PSD files written by psd-tools, as programs write them: what comes out is compared with the drawn pixels."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from psd_tools import PSDImage
from psd_tools.api.layers import PixelLayer
from psd_tools.constants import BlendMode, Compression

from tests.puppet.imports.drawings import ARM, HAND, SIZE, TORSO, Drawn, assert_same_picture, random_picture
from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.psd import read_psd
from wildpuppet.puppet.imports.result import Imported
from wildpuppet.types import JointSpec


def add(group: object, drawn: Drawn, name: str, **more: object) -> PixelLayer:
    x, y = drawn.corner
    layer = group.create_pixel_layer(Image.fromarray(drawn.rgba), name=name, left=x, top=y, **more)
    assert isinstance(layer, PixelLayer)
    return layer


def read(document: PSDImage, folder: Path, **more: bool) -> Imported:
    document.save(folder / "figure.psd")
    return read_psd(folder / "figure.psd", **more)


@pytest.mark.parametrize("compression", [Compression.RAW, Compression.RLE, Compression.ZIP])
@pytest.mark.parametrize("mode", ["RGB", "RGBA"])
def test_layers_keep_pixels_places_names_and_order(tmp_path: Path, mode: str, compression: Compression) -> None:
    document = PSDImage.new(mode, SIZE)
    for drawn, name in ((TORSO, "torso"), (ARM, "Arm / größer"), (HAND, "hand")):
        add(document, drawn, name, compression=compression)
    found = read(document, tmp_path)
    assert found.cutout.canvas == SIZE
    assert [part.name for part in found.cutout.parts] == ["torso", "Arm / größer", "hand"]
    for part, drawn in zip(found.cutout.parts, (TORSO, ARM, HAND), strict=True):
        assert_same_picture(part.rgba, drawn.on_canvas())
    assert found.cutout.joints == (JointSpec(("torso", "Arm / größer")), JointSpec(("Arm / größer", "hand")))
    assert any("'hand' reaches beyond the canvas" in note for note in found.notes)


def test_hidden_layers_and_groups_the_paper_and_adjustments_are_left_out(tmp_path: Path) -> None:
    document = PSDImage.new("RGB", SIZE)
    add(document, Drawn(random_picture(9, *SIZE, alpha=255), (0, 0)), "Background")
    group = document.create_group(name="limbs")
    add(group, TORSO, "torso")
    add(group, ARM, "sketch").visible = False
    away = document.create_group(name="old")
    add(away, HAND, "hand")
    away.visible = False
    found = read(document, tmp_path)
    assert [part.name for part in found.cutout.parts] == ["torso"]
    told = " ".join(found.notes)
    assert "'sketch' is hidden" in told
    assert "'hand' is hidden" in told
    assert "'Background' covers the whole canvas" in told


def test_opacity_of_layers_and_groups_and_masks_become_alpha(tmp_path: Path) -> None:
    document = PSDImage.new("RGB", SIZE)
    group = document.create_group(name="group")
    group.opacity = 128
    solid = Drawn(random_picture(4, 40, 40, alpha=255), (20, 15))
    layer = add(group, solid, "torso", opacity=64)
    mask = np.random.default_rng(5).integers(0, 256, (20, 30), np.uint8)
    layer.update_mask(Image.fromarray(mask), left=25, top=20)
    (part,) = read(document, tmp_path).cutout.parts
    expected = np.zeros((SIZE[1], SIZE[0]))
    expected[20:40, 25:55] = mask * (64 / 255) * (128 / 255)  # what the mask does not reach is hidden
    assert np.abs(part.rgba[..., 3] - expected).max() <= 1.0  # rounded once for the layer, once for the group


def test_clipped_layers_are_painted_onto_the_layer_below(tmp_path: Path) -> None:
    document = PSDImage.new("RGB", SIZE)
    add(document, Drawn(random_picture(6, 40, 40, alpha=255), (20, 15)), "torso")
    shade = Drawn(random_picture(7, 60, 20, alpha=255), (30, 25))
    add(document, shade, "shade").clipping = True
    found = read(document, tmp_path)
    (part,) = found.cutout.parts
    expected = Drawn(random_picture(6, 40, 40, alpha=255), (20, 15)).on_canvas()
    covered = expected[..., 3] > 0
    expected[covered & (shade.on_canvas()[..., 3] > 0)] = shade.on_canvas()[covered & (shade.on_canvas()[..., 3] > 0)]
    assert_same_picture(part.rgba, expected, tolerance=1)
    assert any("'shade' is painted onto the layer" in note for note in found.notes)


def test_blend_modes_are_told(tmp_path: Path) -> None:
    document = PSDImage.new("RGB", SIZE)
    add(document, TORSO, "torso").blend_mode = BlendMode.MULTIPLY
    found = read(document, tmp_path)
    assert_same_picture(found.cutout.parts[0].rgba, TORSO.on_canvas())
    assert any("'torso' was blended by multiply" in note for note in found.notes)


def test_groups_can_be_merged_into_one_part_each(tmp_path: Path) -> None:
    document = PSDImage.new("RGB", SIZE)
    add(document, TORSO, "torso")
    group = document.create_group(name="arm")
    colour, line = Drawn(random_picture(8, 30, 12, alpha=255), (50, 20)), Drawn(random_picture(9, 8, 12), (60, 16))
    add(group, colour, "colour")
    add(group, line, "line")
    found = read(document, tmp_path, merge_groups=True).cutout
    assert [part.name for part in found.parts] == ["torso", "arm"]
    # Alpha-over, by hand, where both are: the colour layer is opaque there.
    above, below = line.on_canvas().astype(float), colour.on_canvas().astype(float)
    both = (above[..., 3] > 0) & (below[..., 3] > 0)
    share = above[..., 3:] / 255
    expected = above[..., :3] * share + below[..., :3] * (1 - share)
    assert np.abs(found.parts[1].rgba[both][:, :3] - expected[both]).max() <= 0.5 + 1e-9
    assert (found.parts[1].rgba[both][:, 3] == 255).all()


def test_same_names_are_numbered_and_groups_tie_their_layers_first(tmp_path: Path) -> None:
    document = PSDImage.new("RGB", SIZE)
    add(document, Drawn(random_picture(1, 50, 50), (10, 10)), "torso")
    group = document.create_group(name="arm")
    add(group, Drawn(random_picture(2, 14, 14), (40, 20)), "piece")
    add(group, Drawn(random_picture(3, 14, 14), (46, 26)), "piece")
    found = read(document, tmp_path).cutout
    assert [part.name for part in found.parts] == ["torso", "piece", "piece 2"]
    assert JointSpec(("piece", "piece 2")) in found.joints


def test_sixteen_bit_and_grey_documents_are_read(tmp_path: Path) -> None:
    deep = PSDImage.new("RGB", SIZE, depth=16)
    add(deep, TORSO, "torso")
    assert_same_picture(read(deep, tmp_path).cutout.parts[0].rgba, TORSO.on_canvas(), tolerance=1)
    grey = PSDImage.new("L", SIZE)
    picture = random_picture(2, 40, 40)
    picture[..., :3] = picture[..., :1]
    grey.create_pixel_layer(Image.fromarray(picture).convert("LA"), name="torso", left=20, top=15)
    assert_same_picture(read(grey, tmp_path).cutout.parts[0].rgba, Drawn(picture, (20, 15)).on_canvas(), tolerance=1)


def test_a_flat_file_and_one_with_nothing_visible_are_refused(tmp_path: Path) -> None:
    PSDImage.frompil(Image.fromarray(random_picture(1, *SIZE)[..., :3])).save(tmp_path / "flat.psd")
    with pytest.raises(PuppetError, match="one flat picture; expected one layer per part"):
        read_psd(tmp_path / "flat.psd")
    document = PSDImage.new("RGB", SIZE)
    add(document, TORSO, "torso").visible = False
    with pytest.raises(PuppetError, match="no layer shows anything"):
        read(document, tmp_path)


def sound(folder: Path) -> Path:
    document = PSDImage.new("RGB", SIZE)
    add(document, TORSO, "torso", compression=Compression.ZIP)
    document.save(folder / "sound.psd")
    return folder / "sound.psd"


def test_a_huge_canvas_is_refused_by_its_header(tmp_path: Path) -> None:
    path = sound(tmp_path)
    data = bytearray(path.read_bytes())
    data[14:22] = (30000).to_bytes(4, "big") * 2
    path.write_bytes(data)
    with pytest.raises(PuppetError, match="canvas 30000 x 30000 is too big"):
        read_psd(path)


def test_broken_files_are_refused_in_one_line(tmp_path: Path) -> None:
    path = sound(tmp_path)
    data = path.read_bytes()
    generator = np.random.default_rng(0)
    told = []
    for _ in range(150):
        broken = bytearray(data[: generator.integers(30, len(data))]) if generator.random() < 0.3 else bytearray(data)
        for place in generator.integers(26, len(broken), 4):
            broken[place] = generator.integers(0, 256)
        path.write_bytes(broken)
        try:
            read_psd(path)
        except PuppetError as error:
            told.append(str(error))
    assert len(told) > 50
    assert not any("\n" in words for words in told)


def test_text_is_no_psd(tmp_path: Path) -> None:
    (tmp_path / "a.psd").write_text("hello, this is no picture at all")
    with pytest.raises(PuppetError, match="begins with 8BPS"):
        read_psd(tmp_path / "a.psd")
