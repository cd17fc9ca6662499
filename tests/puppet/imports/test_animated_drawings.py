"""A stick figure as AnimatedDrawings stores it: every limb has a colour, so that a wrong cut shows."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.check import check
from wildpuppet.puppet.imports import formats
from wildpuppet.puppet.imports.animated_drawings import read_animated_drawings

SIZE = (300, 400)
SKELETON = {
    "root": (None, (150, 230)), "torso": ("root", (150, 130)), "neck": ("torso", (150, 60)),
    "right_shoulder": ("torso", (115, 130)), "right_elbow": ("right_shoulder", (70, 170)),
    "right_hand": ("right_elbow", (40, 220)), "left_shoulder": ("torso", (185, 130)),
    "left_elbow": ("left_shoulder", (230, 170)), "left_hand": ("left_elbow", (260, 220)),
    "right_hip": ("root", (130, 235)), "right_knee": ("right_hip", (125, 300)),
    "right_foot": ("right_knee", (120, 365)),
    "left_hip": ("root", (172, 235)), "left_knee": ("left_hip", (177, 300)), "left_foot": ("left_knee", (182, 365)),
}  # fmt: skip
LIMBS = {
    "head": ("torso", "neck", 44), "right_upper_arm": ("right_shoulder", "right_elbow", 20),
    "right_forearm": ("right_elbow", "right_hand", 16), "left_upper_arm": ("left_shoulder", "left_elbow", 20),
    "left_forearm": ("left_elbow", "left_hand", 16), "right_thigh": ("right_hip", "right_knee", 24),
    "right_shin": ("right_knee", "right_foot", 20), "left_thigh": ("left_hip", "left_knee", 24),
    "left_shin": ("left_knee", "left_foot", 20),
}  # fmt: skip


def colour_of(name: str) -> tuple[int, int, int]:
    number = 1 + list(LIMBS).index(name) if name in LIMBS else 0
    return 20 * number + 10, 255 - 20 * number, 40 * (number % 5)


def figure() -> tuple[np.ndarray, np.ndarray]:
    texture = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    texture[...] = (9, 9, 9, 255)
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    for canvas, colour in ((texture, (*colour_of("trunk"), 255)), (mask, 255)):
        cv2.rectangle(canvas, (105, 115), (195, 250), colour, -1)
    for name, (start, end, width) in LIMBS.items():
        ends = SKELETON[start][1], SKELETON[end][1]
        cv2.line(texture, *ends, (*colour_of(name), 255), width, cv2.LINE_8)
        cv2.line(mask, *ends, 255, width, cv2.LINE_8)
    return texture, mask


def saved(folder: Path, **changes: object) -> Path:
    texture, mask = figure()
    Image.fromarray(texture).save(folder / "texture.png")
    Image.fromarray(mask).save(folder / "mask.png")
    skeleton = [{"name": name, "parent": parent, "loc": list(at)} for name, (parent, at) in SKELETON.items()]
    config = {"width": SIZE[0], "height": SIZE[1], "skeleton": skeleton, **changes}
    (folder / "char_cfg.yaml").write_text(yaml.safe_dump(config))
    return folder


def test_the_figure_is_cut_at_its_joints(tmp_path: Path) -> None:
    assert formats.recognised(saved(tmp_path)) == "animated-drawings"
    cutout = read_animated_drawings(tmp_path).cutout
    assert {part.name for part in cutout.parts} == {"trunk", *LIMBS}
    assert cutout.parts[0].name == "trunk"
    texture, mask = figure()
    covered = np.zeros(mask.shape, bool)
    for part in cutout.parts:
        alpha = part.rgba[..., 3] > 0
        covered |= alpha
        assert np.array_equal(part.rgba[alpha], texture[alpha])
        # Most of a part is its own colour; the discs around its joints are not.
        own = (part.rgba[alpha][:, :3] == colour_of(part.name)).all(axis=1)
        assert own.mean() > 0.6, part.name
    assert np.array_equal(covered, mask > 0)


def test_joints_are_the_skeletons_and_the_check_is_content(tmp_path: Path) -> None:
    cutout = read_animated_drawings(saved(tmp_path)).cutout
    found = {frozenset(joint.parts): joint.at for joint in cutout.joints}
    assert len(found) == len(LIMBS)
    assert found[frozenset({"trunk", "head"})] == SKELETON["torso"][1]
    assert found[frozenset({"trunk", "left_upper_arm"})] == SKELETON["left_shoulder"][1]
    assert found[frozenset({"left_upper_arm", "left_forearm"})] == SKELETON["left_elbow"][1]
    assert found[frozenset({"trunk", "right_thigh"})] == SKELETON["right_hip"][1]
    assert found[frozenset({"right_thigh", "right_shin"})] == SKELETON["right_knee"][1]
    assert check(cutout) == []


def test_other_skeletons_are_cut_at_every_bone(tmp_path: Path) -> None:
    """A tail of three bones on a body: not AnimatedDrawings' own joint names."""
    saved(tmp_path)
    skeleton = [
        {"name": "body", "parent": None, "loc": [150, 180]},
        {"name": "hip", "parent": "body", "loc": [150, 120]},
        {"name": "tail1", "parent": "hip", "loc": [70, 170]},
        {"name": "tail2", "parent": "tail1", "loc": [40, 220]},
    ]
    cutout = read_animated_drawings(saved(tmp_path, skeleton=skeleton)).cutout
    assert [part.name for part in cutout.parts] == ["trunk", "hip-tail1", "tail1-tail2"]
    assert [joint.at for joint in cutout.joints] == [(150, 120), (70, 170)]


JOINT = {"name": "root", "parent": None, "loc": [150, 230]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": 301}, "says 301 x 400; all three must be the same"),
        ({"width": "wide"}, "width is 'wide'"),
        ({"skeleton": [JOINT]}, "2 to 500 joints"),
        ({"skeleton": [JOINT, JOINT]}, "a name of its own; found 'root'"),
        ({"skeleton": [JOINT, {**JOINT, "name": "b"}]}, "only it, has no parent"),
        ({"skeleton": [{**JOINT, "parent": "root"}, {**JOINT, "name": "b"}]}, "not above it"),
        ({"skeleton": [JOINT, {"name": "b", "parent": "root", "loc": [float("nan"), 3]}]}, "loc is nan"),
        ({"skeleton": [JOINT, {"name": "b", "parent": "root", "loc": [3]}]}, r"expected \[x, y\]"),
        ({"skeleton": [JOINT, {"name": "b", "parent": "root", "loc": [0, 0]}]}, None),
    ],
)
def test_skeletons_that_are_none_are_refused(tmp_path: Path, changes: dict[str, object], words: str | None) -> None:
    saved(tmp_path, **changes)
    if words is None:
        assert [part.name for part in read_animated_drawings(tmp_path).cutout.parts]
        return
    with pytest.raises(PuppetError, match=words) as caught:
        read_animated_drawings(tmp_path)
    assert "\n" not in str(caught.value)


LEVELS = "".join(f"l{level}: &l{level} [{', '.join([f'*l{level - 1}'] * 9)}]\n" for level in range(1, 30))
BOMB = f"""l0: &l0 [x]
{LEVELS}width: {SIZE[0]}
height: {SIZE[1]}
skeleton: [{{name: a, parent: null, loc: [1, 2]}}, {{name: b, parent: a, loc: *l29}}]
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "joint 'b' loc is a list"),
        ("a: &a {b: c}\nskeleton: [{<<: [*a, *a]}]", "merge keys"),
        ("skeleton: !!python/object/apply:os.system ['true']", "not valid YAML"),
        ("[" * 5000, "not valid YAML"),
        ("just words", "found str"),
    ],
)
def test_hostile_yaml_is_refused(tmp_path: Path, text: str, words: str) -> None:
    saved(tmp_path)
    (tmp_path / "char_cfg.yaml").write_text(text)
    with pytest.raises(PuppetError, match=words) as caught:
        read_animated_drawings(tmp_path)
    assert "\n" not in str(caught.value)


def test_missing_and_empty_pictures_are_named(tmp_path: Path) -> None:
    saved(tmp_path)
    Image.new("L", SIZE).save(tmp_path / "mask.png")
    with pytest.raises(PuppetError, match="nothing is white"):
        read_animated_drawings(tmp_path)
    (tmp_path / "texture.png").unlink()
    with pytest.raises(PuppetError, match=r"texture\.png: expected a file, found nothing"):
        read_animated_drawings(tmp_path)
