"""DragonBones rigs: bones, pictures and meshes against the format's own runtime, pixels against closed forms.

``tests/data/dragonbones_setup.json`` holds two rigs of random transforms (mirrored, skewed, with every kind of broken
inheritance) and where the JavaScript runtime puts their bones, pictures and mesh vertices in the setup pose.
"""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.puppet.imports.drawings import assert_same_picture, random_picture
from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports import dragonbones, formats
from wildpuppet.puppet.imports.dragonbones_atlas import Textures
from wildpuppet.puppet.imports.dragonbones_pose import read_bones
from wildpuppet.types import JointSpec

TRUTH = json.loads((Path(__file__).parents[2] / "data" / "dragonbones_setup.json").read_text(encoding="utf-8"))


def matrix(six: list[float]) -> np.ndarray:
    return np.array([[six[0], six[2], six[4]], [six[1], six[3], six[5]]])


@pytest.mark.parametrize("case", TRUTH["cases"], ids=["first", "second"])
def test_bones_stand_where_the_runtime_puts_them(case: dict[str, Any]) -> None:
    bones = read_bones(case["rig"]["armature"][0]["bone"], "rig")
    for bone in bones:
        assert np.abs(bone.armature_from_bone - matrix(case["bones"][bone.name])).max() < 1e-5, bone.name


@pytest.mark.parametrize("case", TRUTH["cases"], ids=["first", "second"])
def test_pictures_and_meshes_lie_where_the_runtime_draws_them(tmp_path: Path, case: dict[str, Any]) -> None:
    (tmp_path / "rig_tex.json").write_text(json.dumps(TRUTH["atlas"]))
    Image.new("RGBA", (128, 64), (9, 9, 9, 255)).save(tmp_path / "rig_tex.png")
    armature = case["rig"]["armature"][0]
    textures = Textures(tmp_path / "rig_ske.json", None)
    shown = dragonbones._shown(armature, read_bones(armature["bone"], "rig"), textures, "rig", [])
    assert [slot.name for slot in shown] == ["plain", "turned", "trimmed", "free", "weighted"]
    for slot in shown:
        truth = case["slots"][slot.name]
        placed = matrix(truth["matrix"])
        if slot.mesh is None:
            # The runtime draws the atlas's region: the trimmed one begins at (4, 6) of its whole picture.
            corner = (4.0, 6.0, 1.0) if slot.name == "trimmed" else (0.0, 0.0, 1.0)
            x, y = truth["pivot"]
            assert np.abs(slot.armature_from_picture @ corner - placed @ (-x, -y, 1.0)).max() < 1e-4
            assert np.abs(slot.armature_from_picture[:, :2] - placed[:, :2]).max() < 1e-5
        else:
            vertices = np.array(truth["vertices"]).reshape(-1, 2)
            if not truth["weighted"]:
                vertices = np.column_stack([vertices, np.ones(len(vertices))]) @ placed.T
            assert np.abs(slot.mesh.vertices - vertices).max() < 1e-4


def rig(bones: list[dict[str, Any]], slots: list[dict[str, Any]], displays: dict[str, Any]) -> dict[str, Any]:
    skin = {"name": "", "slot": [{"name": name, "display": [display]} for name, display in displays.items()]}
    armature = {"type": "Armature", "name": "rig", "bone": bones, "slot": slots, "skin": [skin], "animation": []}
    return {"frameRate": 24, "name": "rig", "version": "5.5", "compatibleVersion": "5.5", "armature": [armature]}


TORSO, ARM, HAND = random_picture(1, 40, 60), random_picture(2, 30, 12), random_picture(3, 14, 16)
BONES = [
    {"name": "root"},
    {"name": "torso", "parent": "root", "transform": {"x": 0, "y": -30}},
    {"name": "arm", "parent": "torso", "transform": {"x": 15, "y": -20, "skX": 90, "skY": 90}},
    {"name": "hand", "parent": "arm", "transform": {"x": 26, "y": 0}},
]
SLOTS = [{"name": name, "parent": name} for name in ("hand", "torso", "arm")]
SQUARE = {"vertices": [-4, -6, 26, -6, 26, 6, -4, 6], "uvs": [0, 0, 1, 0, 1, 1, 0, 1], "triangles": [0, 1, 2, 0, 2, 3]}
DISPLAYS = {
    "torso": {"name": "art/torso"},
    "arm": {"type": "mesh", "name": "arm", "path": "art/arm", **SQUARE},
    "hand": {"name": "hand"},
}
RIG = rig(BONES, SLOTS, DISPLAYS)


def atlas() -> tuple[dict[str, Any], np.ndarray]:
    """Torso trimmed of two empty rows, arm turned clockwise, hand as it is."""
    page = np.zeros((100, 100, 4), np.uint8)
    page[5:63, 3:43] = TORSO[1:59]
    page[5:35, 50:62] = np.rot90(ARM, -1)
    page[70:86, 60:74] = HAND
    regions = [
        {"name": "art/torso", "x": 3, "y": 5, "width": 40, "height": 58,
         "frameX": 0, "frameY": -1, "frameWidth": 40, "frameHeight": 60},
        {"name": "art/arm", "x": 50, "y": 5, "width": 12, "height": 30, "rotated": True},
        {"name": "hand", "x": 60, "y": 70, "width": 14, "height": 16},
    ]  # fmt: skip
    return {"name": "rig", "imagePath": "rig_tex.png", "SubTexture": regions}, page


def saved(folder: Path, tree: dict[str, Any] = RIG, **changes: object) -> Path:
    texture, page = atlas()
    Image.fromarray(page).save(folder / "rig_tex.png")
    (folder / "rig_tex.json").write_text(json.dumps({**texture, **changes}))
    (folder / "rig_ske.json").write_text(json.dumps(tree))
    return folder / "rig_ske.json"


def test_whole_shifts_and_quarter_turns_keep_every_pixel(tmp_path: Path) -> None:
    path = saved(tmp_path)
    assert formats.recognised(path) == formats.recognised(tmp_path) == "dragonbones"
    found = dragonbones.read_dragonbones(tmp_path)
    hand, torso, arm = found.cutout.parts
    assert (hand.name, torso.name, arm.name) == ("hand", "torso", "arm")
    # The torso's middle stands at (0, -30); it is 40 x 60: its corner is (-20, -60), the drawing's topmost left.
    assert "the rig's origin stands at 28,68 on the canvas" in found.notes
    expected = np.zeros_like(torso.rgba)
    expected[8 + 1 : 8 + 59, 8:48] = TORSO[1:59]
    assert_same_picture(torso.rgba, expected)
    # The arm hangs down from (15, -50): a quarter turn clockwise, its mesh from (9, -54) to (21, -24) of the rig.
    turned = np.zeros_like(arm.rgba)
    turned[68 - 54 : 68 - 24, 28 + 9 : 28 + 21] = np.rot90(ARM, -1)
    assert_same_picture(arm.rgba, turned, tolerance=2)
    # The hand's middle lies 26 further down, at (15, -24): a picture turned by a quarter, 16 x 14.
    down = np.zeros_like(hand.rgba)
    down[68 - 31 : 68 - 17, 28 + 7 : 28 + 23] = np.rot90(HAND, -1)
    assert_same_picture(hand.rgba, down, tolerance=2)


def test_bones_are_hinges(tmp_path: Path) -> None:
    cutout = dragonbones.read_dragonbones(saved(tmp_path)).cutout
    assert set(cutout.joints) == {
        JointSpec(("torso", "arm"), (28.0 + 15.0, 68.0 - 50.0)),
        JointSpec(("arm", "hand"), (28.0 + 15.0, 68.0 - 24.0)),
    }


def test_parts_of_one_bone_hang_together_and_named_bones_tie_parts(tmp_path: Path) -> None:
    slots = [{"name": name, "parent": "torso"} for name in ("torso", "arm")] + [{"name": "hand", "parent": "hand"}]
    bones = [*BONES[:2], {"name": "hand", "transform": {"x": 20, "y": -30}}]
    cutout = dragonbones.read_dragonbones(saved(tmp_path, rig(bones, slots, DISPLAYS))).cutout
    assert cutout.joints[0] == JointSpec(("torso", "arm"))
    named = [*bones, {"name": "torso_to_hand", "transform": {"x": 14, "y": -30}}]
    cutout = dragonbones.read_dragonbones(saved(tmp_path, rig(named, slots, DISPLAYS))).cutout
    assert cutout.joints[0].parts == ("torso", "hand")
    assert cutout.joints[0].at == (28.0 + 14.0, 68.0 - 30.0)


def test_slots_that_show_nothing_are_left_out_and_tints_applied(tmp_path: Path) -> None:
    tree = copy.deepcopy(RIG)
    armature = tree["armature"][0]
    armature["slot"][0]["displayIndex"] = -1
    armature["slot"][1]["color"] = {"aM": 50, "rM": 20}
    armature["slot"][2]["blendMode"] = "add"
    found = dragonbones.read_dragonbones(saved(tmp_path, tree))
    torso = found.cutout.parts[0]
    assert [part.name for part in found.cutout.parts] == ["torso", "arm"]
    seen = torso.rgba[9:67, 8:48].astype(float)
    assert np.abs(seen[..., 3] - TORSO[1:59, :, 3] * 0.5).max() <= 0.5
    assert np.abs(seen[..., 0] - TORSO[1:59, :, 0] * 0.2)[seen[..., 3] > 0].max() <= 0.5
    told = " ".join(found.notes)
    assert "slot 'hand' shows nothing" in told
    assert "'arm' is blended by add" in told


def test_single_pictures_stand_in_for_an_atlas(tmp_path: Path) -> None:
    path = tmp_path / "rig_ske.json"
    path.write_text(json.dumps(RIG))
    (tmp_path / "texture" / "art").mkdir(parents=True)
    Image.fromarray(TORSO).save(tmp_path / "texture" / "art" / "torso.png")
    Image.fromarray(ARM).save(tmp_path / "texture" / "art" / "arm.png")
    Image.fromarray(HAND).save(tmp_path / "hand.png")
    assert len(dragonbones.read_dragonbones(path).cutout.parts) == 3


def changed(where: str, value: object) -> dict[str, Any]:
    tree = copy.deepcopy(RIG)
    place: Any = tree
    *steps, last = where.split("/")
    for step in steps:
        place = place[int(step) if step.isdecimal() else step]
    place[int(last) if last.isdecimal() else last] = value
    return tree


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (changed("compatibleVersion", "2.3"), "version '2.3'; export it as 4.0 or newer"),
        (changed("armature", []), "expected a list 'armature'"),
        (changed("armature/0/bone", []), "expected a list of bones"),
        (changed("armature/0/bone/1/parent", "hand"), "is its own ancestor"),
        (changed("armature/0/bone/1/parent", "nobody"), "unknown parent 'nobody'"),
        (changed("armature/0/bone/1/name", "root"), "two bones have the same name"),
        (changed("armature/0/bone/1/transform", {"x": 1e300}), "bone 'torso': x is 1e"),
        (changed("armature/0/bone/1/transform", {"x": float("nan")}), "NaN is no number"),
        (changed("armature/0/bone/1/transform", {"scX": 900000, "scY": 900000}), "canvas .* is too big|no usable rig"),
        (changed("armature/0/slot/0/parent", "nobody"), "slot 'hand' has no name or hangs on no bone"),
        (changed("armature/0/skin", []), "no skin with displays"),
        (changed("armature/0/skin/0/slot/0/display/0/name", "none"), "picture 'none' is in no atlas"),
        (changed("armature/0/skin/0/slot/0/display/0/name", "../../../etc/x"), "lies outside its folder"),
        (changed("armature/0/skin/0/slot/1/display/0/uvs", [0, 0]), "do not fit its 4 vertices"),
        (changed("armature/0/skin/0/slot/1/display/0/triangles", [0, 1, 99]), "do not fit its 4 vertices"),
        (changed("armature/0/skin/0/slot/1/display/0/weights", [1, 0, 1.0]), "slotPose: expected a list of numbers"),
    ],
)
def test_hostile_rigs_are_refused_in_one_line(tmp_path: Path, tree: dict[str, Any], words: str) -> None:
    with pytest.raises(PuppetError, match=words) as caught:
        dragonbones.read_dragonbones(saved(tmp_path, tree))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"imagePath": "../../etc/passwd"}, "lies outside its folder"),
        ({"imagePath": "none.png"}, "found nothing"),
        ({"scale": 0}, "scale is 0"),
        ({"SubTexture": [{"name": "hand", "x": 90, "y": 0, "width": 40, "height": 20}]}, "lies outside its page"),
        ({"SubTexture": [{"name": "hand", "x": 0, "y": 0, "width": 4, "height": 2, "frameWidth": 10**6,
                          "frameHeight": 10**6}]}, "does not hold the region"),
    ],
)  # fmt: skip
def test_hostile_atlases_are_refused_in_one_line(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    with pytest.raises(PuppetError, match=words):
        dragonbones.read_dragonbones(saved(tmp_path, **changes))
