from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.puppet.imports.drawings import ARM, HAND, SIZE, TORSO, assert_same_picture
from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.png_folder import natural, read_png_folder


def filled(folder: Path, *names: str) -> Path:
    for name, drawn in zip(names, (TORSO, ARM, HAND), strict=False):
        Image.fromarray(drawn.on_canvas()).save(folder / name)
    return folder


def test_numbers_order_the_parts_as_a_person_would(tmp_path: Path) -> None:
    found = read_png_folder(filled(tmp_path, "2 torso.png", "10_arm.PNG", "11-hand.png"))
    assert [part.name for part in found.cutout.parts] == ["torso", "arm", "hand"]
    assert found.cutout.canvas == SIZE
    for part, drawn in zip(found.cutout.parts, (TORSO, ARM, HAND), strict=True):
        assert_same_picture(part.rgba, drawn.on_canvas())


def test_numbers_stay_in_names_that_would_be_alike_without(tmp_path: Path) -> None:
    found = read_png_folder(filled(tmp_path, "1_leg.png", "2_leg.png", "3_arm.png"))
    assert [part.name for part in found.cutout.parts] == ["1_leg", "2_leg", "3_arm"]


def test_palette_and_grey_pictures_keep_their_alpha(tmp_path: Path) -> None:
    picture = TORSO.on_canvas()
    picture[..., :3] = picture[..., :1]
    Image.fromarray(picture).convert("LA").save(tmp_path / "a.png")
    clear = np.where(picture[..., 3:] > 128, [[[200, 30, 40, 255]]], [[[0, 0, 0, 0]]]).astype(np.uint8)
    Image.fromarray(clear).quantize(4).save(tmp_path / "b.png")
    a, b = read_png_folder(tmp_path).cutout.parts
    assert_same_picture(a.rgba, picture)
    assert_same_picture(b.rgba, clear)


def test_other_files_are_passed_over_with_a_word(tmp_path: Path) -> None:
    filled(tmp_path, "a.png", "b.png")
    (tmp_path / "notes.txt").write_text("mine")
    assert "passed over notes.txt" in read_png_folder(tmp_path).notes


def test_sizes_and_alpha_that_do_not_fit_are_named(tmp_path: Path) -> None:
    filled(tmp_path, "a.png")
    Image.fromarray(ARM.rgba).save(tmp_path / "b.png")
    with pytest.raises(PuppetError, match=r"b\.png: is 30 x 12, the first picture is 90 x 70; save every part on"):
        read_png_folder(tmp_path)
    Image.fromarray(TORSO.on_canvas()[..., :3]).save(tmp_path / "b.png")
    with pytest.raises(PuppetError, match=r"b\.png: has no alpha \(mode RGB\)"):
        read_png_folder(tmp_path)
    (tmp_path / "b.png").write_bytes((tmp_path / "a.png").read_bytes()[:300])
    with pytest.raises(PuppetError, match=r"b\.png: cannot be read"):
        read_png_folder(tmp_path)


def test_natural_order() -> None:
    assert sorted(["b", "a10", "A2", "a1", "10", "9"], key=natural) == ["9", "10", "a1", "A2", "a10", "b"]
