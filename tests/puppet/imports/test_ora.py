"""OpenRaster files made by hand from the specification (a zip, stored mimetype first, stack.xml front to back)."""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.puppet.imports.drawings import ARM, HAND, SIZE, TORSO, Drawn, assert_same_picture, random_picture
from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.ora import read_ora


def png(picture: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def saved(
    folder: Path, stack: str, pictures: dict[str, bytes], *, size: tuple[int, int] = SIZE, head: str = ""
) -> Path:
    path = folder / "figure.ora"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", "image/openraster", zipfile.ZIP_STORED)
        archive.writestr(
            "stack.xml",
            f'<?xml version="1.0" encoding="UTF-8"?>{head}<image w="{size[0]}" h="{size[1]}">{stack}</image>',
        )
        for name, data in pictures.items():
            archive.writestr(name, data, zipfile.ZIP_DEFLATED)
    return path


PICTURES = {f"data/{name}.png": png(drawn.rgba) for name, drawn in (("torso", TORSO), ("arm", ARM), ("hand", HAND))}


def test_layers_come_back_to_front_with_offsets_of_nested_stacks_added_up(tmp_path: Path) -> None:
    stack = """<stack>
      <stack name="limb" x="40" y="-4">
        <layer name="hand" src="data/hand.png" x="35" y="23" />
        <layer name="arm" src="data/arm.png" x="10" y="24" composite-op="svg:src-over" opacity="1.0" />
      </stack>
      <text x="3" />
      <layer name="torso" src="data/torso.png" x="20" y="15" composite-op="svg:multiply"/>
    </stack>"""
    found = read_ora(saved(tmp_path, stack, PICTURES))
    assert found.cutout.canvas == SIZE
    assert [part.name for part in found.cutout.parts] == ["torso", "arm", "hand"]
    for part, drawn in zip(found.cutout.parts, (TORSO, ARM, HAND), strict=True):
        assert_same_picture(part.rgba, drawn.on_canvas())
    assert any("'torso' was blended by svg:multiply" in note for note in found.notes)
    assert any("stacks have offsets" in note for note in found.notes)


def test_opacity_multiplies_and_hidden_stacks_hide(tmp_path: Path) -> None:
    stack = """<stack opacity="0.5">
      <stack visibility="hidden"><layer name="hand" src="data/hand.png" /></stack>
      <layer name="arm" src="data/arm.png" visibility="hidden" />
      <layer name="torso" src="data/torso.png" opacity="0.4" x="20" y="15" />
    </stack>"""
    found = read_ora(saved(tmp_path, stack, PICTURES))
    (part,) = found.cutout.parts
    expected = TORSO.on_canvas()
    assert np.abs(part.rgba[..., 3] - expected[..., 3] * 0.2).max() <= 0.5 + 1e-6
    assert [note for note in found.notes if "hidden" in note] == [
        "'arm' is hidden and left out",
        "'hand' is hidden and left out",
    ]


def test_paper_is_left_out_and_groups_merge_when_asked(tmp_path: Path) -> None:
    paper = Drawn(random_picture(5, *SIZE, alpha=255), (0, 0))
    stack = """<stack>
      <stack name="limb"><layer name="hand" src="data/hand.png" x="75" y="19" />
      <layer name="arm" src="data/arm.png" x="50" y="20" />
      </stack><layer name="torso" src="data/torso.png" x="20" y="15" /><layer name="paper" src="data/paper.png" />
    </stack>"""
    path = saved(tmp_path, stack, {**PICTURES, "data/paper.png": png(paper.rgba)})
    assert [part.name for part in read_ora(path).cutout.parts] == ["torso", "arm", "hand"]
    assert [part.name for part in read_ora(path, merge_groups=True).cutout.parts] == ["torso", "limb"]


LAYER = '<stack><layer name="torso" src="data/torso.png" /></stack>'
LAUGHS = '<!DOCTYPE image [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
FILE = '<!DOCTYPE image [<!ENTITY a SYSTEM "file:///etc/hostname">]>'


@pytest.mark.parametrize(
    ("stack", "head", "size", "words"),
    [
        (f"{LAYER}&b;", LAUGHS, SIZE, "EntitiesForbidden"),
        (f"{LAYER}&a;", FILE, SIZE, "EntitiesForbidden"),
        (LAYER, "", (30000, 30000), "canvas 30000 x 30000 is too big"),
        (LAYER, "", (0, 70), "at least one pixel"),
        (LAYER.replace("data/torso.png", "../../etc/passwd.png"), "", SIZE, "passwd.png is missing"),
        (LAYER.replace("torso.png", "none.png"), "", SIZE, "data/none.png is missing"),
        (LAYER.replace("<layer", '<layer x="nan"'), "", SIZE, "'torso' x is 'nan'"),
        (LAYER.replace("<layer", '<layer opacity="1e999"'), "", SIZE, "'torso' opacity is '1e999'"),
        ("<stack>" * 100 + "</stack>" * 100, "", SIZE, "more than 64 deep"),
        ("<stack>", "", SIZE, "XML that cannot be used"),
        ("", "", SIZE, "no image with a stack"),
        (LAYER.replace("torso.png", "torso.svg"), "", SIZE, "no layer shows anything"),
    ],
)
def test_hostile_stacks_are_refused_in_one_line(
    tmp_path: Path, stack: str, head: str, size: tuple[int, int], words: str
) -> None:
    path = saved(tmp_path, stack, PICTURES, size=size, head=head)
    with pytest.raises(PuppetError, match=words) as caught:
        read_ora(path)
    assert "\n" not in str(caught.value)


def huge_png(width: int, height: int) -> bytes:
    """A PNG whose header promises a huge picture."""
    data = bytearray(png(TORSO.rgba))
    data[16:24] = struct.pack(">II", width, height)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return bytes(data)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (b"not a picture", "not a picture we read"),
        (png(TORSO.rgba)[:-60], "cannot be read"),
        (huge_png(12_000, 12_000), "canvas 12000 x 12000 is too big"),
        (huge_png(100_000, 100_000), "the picture is too big"),
        (b"\0" * (2**28 + 1), "unpacks to 256 MiB"),
    ],
    ids=["text", "cut off", "big", "huge", "bomb"],
)
def test_hostile_pictures_are_refused_before_they_are_unpacked(tmp_path: Path, picture: bytes, words: str) -> None:
    path = saved(tmp_path, LAYER, {"data/torso.png": picture})
    assert path.stat().st_size < 2**20
    with pytest.raises(PuppetError, match=words):
        read_ora(path)


def test_an_archive_that_lies_about_its_sizes_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, LAYER, PICTURES)
    data = path.read_bytes()
    size = struct.pack("<I", len(PICTURES["data/torso.png"]))
    assert data.count(size) >= 2
    path.write_bytes(data.replace(size, struct.pack("<I", 40)))
    with pytest.raises(PuppetError, match=r"broken|cannot be read"):
        read_ora(path)
    path.write_bytes(data[:-30])
    with pytest.raises(PuppetError, match="the archive is broken"):
        read_ora(path)
    end = data.rindex(b"PK\x05\x06")  # the directory begins where no archive can: members lie before the file
    (start,) = struct.unpack_from("<I", data, end + 16)
    path.write_bytes(data[: end + 16] + struct.pack("<I", 2 * start) + data[end + 20 :])
    with pytest.raises(PuppetError, match="the archive is broken"):
        read_ora(path)
