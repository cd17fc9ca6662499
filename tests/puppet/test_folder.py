import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.folder import read_cutout, write_cutout
from wildpuppet.types import CutOut, JointSpec, Part


def make_cutout() -> CutOut:
    pictures = np.random.default_rng(3).integers(0, 256, (3, 20, 30, 4), np.uint8)
    names = ("torso", "Arm / left", "arm / left")
    parts = tuple(Part(name, picture) for name, picture in zip(names, pictures, strict=True))
    joints = (JointSpec(("torso", "Arm / left"), (12.25, 7.5)), JointSpec(("torso", "arm / left")))
    return CutOut((30, 20), parts, joints, 4)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_cutout(make_cutout(), tmp_path / "deep" / "puppet")
    return tmp_path / "deep" / "puppet"


def edit(folder: Path, **changes: object) -> None:
    path = folder / "puppet.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_a_puppet_comes_back_as_it_was(folder):
    before, after = make_cutout(), read_cutout(folder)
    assert (after.canvas, after.joints, after.reference) == (before.canvas, before.joints, before.reference)
    assert [part.name for part in after.parts] == [part.name for part in before.parts]
    for old, new in zip(before.parts, after.parts, strict=True):
        np.testing.assert_array_equal(new.rgba, old.rgba)
    assert [path.name for path in folder.parent.iterdir()] == ["puppet"]


def test_an_existing_folder_is_kept_unless_asked(folder):
    (folder / "outlines.json").write_text("mine")
    with pytest.raises(PuppetError, match="already exists"):
        write_cutout(make_cutout(), folder)
    smaller = CutOut((30, 20), make_cutout().parts[:1])
    write_cutout(smaller, folder, overwrite=True)
    assert len(read_cutout(folder).parts) == 1
    assert (folder / "outlines.json").read_text() == "mine"


def test_joints_and_reference_may_be_left_out_and_unknown_fields_are_named(folder, caplog):
    tree = json.loads((folder / "puppet.json").read_text())
    kept = {key: tree[key] for key in ("schema", "canvas", "parts")}
    (folder / "puppet.json").write_text(json.dumps({**kept, "jionts": []}))
    cutout = read_cutout(folder)
    assert cutout.joints == ()
    assert cutout.reference is None
    assert "jionts" in caplog.text


PART = {"name": "torso", "image": "parts/torso.png"}

BAD_FIELDS = [
    ({"schema": "wildpuppet.puppet/2"}, "newer wildpuppet"),
    ({"schema": "something"}, 'expected "schema"'),
    ({"canvas": [30, 21]}, r"'torso': image parts/torso.png is 30 x 20, the canvas is 30 x 21"),
    ({"canvas": [30, 20000]}, "16384"),
    ({"canvas": [16000, 16000]}, "too big"),
    ({"canvas": [30.5, 20]}, "canvas"),
    ({"parts": []}, "parts"),
    ({"parts": [PART, PART]}, "two parts are named 'torso'"),
    ({"parts": [{"name": "torso"}]}, "image"),
    ({"parts": [{**PART, "image": "parts/none.png"}], "joints": []}, "parts/none.png is missing"),
    ({"parts": [{**PART, "image": "../../other.png"}], "joints": []}, "outside the puppet's folder"),
    ({"parts": [{**PART, "image": "/etc/hostname"}], "joints": []}, "outside the puppet's folder"),
    ({"parts": [{**PART, "image": "puppet.json"}], "joints": []}, "cannot be read"),
    ({"joints": [{"parts": ["torso", "tail"]}]}, "joint 0 names the unknown part 'tail'"),
    ({"joints": [{"parts": ["torso", "torso"]}]}, "to itself"),
    ({"joints": [{"parts": ["torso"]}]}, r"joints\[0\].parts"),
    ({"joints": [{"parts": ["torso", "arm / left"], "at": [1.0, float("inf")]}]}, "finite"),
    ({"joints": [{"parts": ["torso", "arm / left"], "at": [1.0, float("nan")]}]}, "finite"),
    ({"reference": "first"}, "reference"),
]


@pytest.mark.parametrize(("changes", "message"), BAD_FIELDS)
def test_a_bad_field_is_named_in_one_line(folder, changes, message):
    edit(folder, **changes)
    with pytest.raises(PuppetError, match=message) as caught:
        read_cutout(folder)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)


def save(folder: Path, picture: np.ndarray) -> None:
    Image.fromarray(picture).save(folder / "parts" / "torso.png")


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.full((20, 30, 3), 9, np.uint8), "mode RGB without alpha"),
        (np.full((20, 30), 9, np.uint8), "mode L without alpha"),
        (np.full((20, 30, 2), 9, np.uint8), "mode LA; expected 8-bit RGBA"),
        (np.full((21, 30, 4), 9, np.uint8), "30 x 21"),
        (np.zeros((20, 30, 4), np.uint8), "fully transparent"),
    ],
)
def test_a_bad_picture_is_named(folder, picture, message):
    save(folder, picture)
    with pytest.raises(PuppetError, match=message):
        read_cutout(folder)


def test_a_cut_off_picture_is_named(folder):
    path = folder / "parts" / "torso.png"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(PuppetError, match=r"parts/torso.png cannot be read"):
        read_cutout(folder)


def test_bad_json_tells_line_and_column(folder):
    (folder / "puppet.json").write_text('{\n "schema": "wildpuppet.puppet/1",\n oops }')
    with pytest.raises(PuppetError, match="line 3, column 2"):
        read_cutout(folder)
    (folder / "puppet.json").write_text("[1]")
    with pytest.raises(PuppetError, match="expected an object"):
        read_cutout(folder)
    (folder / "puppet.json").write_bytes(b"\xff\xfe{")
    with pytest.raises(PuppetError, match="UTF-8"):
        read_cutout(folder)


def test_a_folder_that_is_none_is_told_apart(tmp_path):
    with pytest.raises(PuppetError, match="found nothing there"):
        read_cutout(tmp_path / "none")
    (tmp_path / "file").write_text("")
    with pytest.raises(PuppetError, match="found a file there"):
        read_cutout(tmp_path / "file")
    with pytest.raises(PuppetError, match=r"no puppet\.json"):
        read_cutout(tmp_path)
