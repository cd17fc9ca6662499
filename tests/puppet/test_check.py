import numpy as np
import pytest

from tests.puppet.test_build import SIZE, bar, disc, two_parts
from wildpuppet.puppet.build import build
from wildpuppet.puppet.check import check
from wildpuppet.puppet.overlay import overlay
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import CutOut, JointSpec, Part

JOINT = JointSpec(("body", "arm"), (130.0, 100.0))


def with_part(name: str, picture: np.ndarray, *joints: JointSpec) -> CutOut:
    sound = two_parts(JOINT)
    return CutOut(SIZE, (*sound.parts, Part(name, picture)), (*sound.joints, *joints))


def body_with(change: str) -> CutOut:
    body, arm = two_parts().parts
    picture = body.rgba.copy()
    if change == "hole":
        picture[80:110, 60:90, 3] = 0
    elif change == "specks":
        picture[5:7, 5:7] = picture[190:192, 5:7] = 255
    elif change == "pieces":
        picture[170:195, 180:230] = 255
    elif change == "glass":
        picture[..., 3] //= 3
    elif change == "sheet":
        picture[..., 3] = 255
    return CutOut(SIZE, (Part("body", picture), arm), (JOINT,))


LEG = bar(80, 140, 100, 195, (1, 2, 3))
APART = bar(180, 150, 220, 190, (1, 2, 3))

FAULTS = [
    (body_with("hole"), "'body' has 1 hole"),
    (body_with("specks"), "'body' has 2 stray speck"),
    (body_with("pieces"), "'body' is 2 separate pieces"),
    (body_with("glass"), "'body' is nearly transparent"),
    (body_with("sheet"), "'body' covers the whole canvas"),
    (with_part("eye", bar(90, 80, 92, 82, (0, 0, 0)), JointSpec(("body", "eye"))), "'eye' is tiny"),
    (with_part("hair", bar(90, 40, 91, 130, (0, 0, 0)), JointSpec(("body", "hair"))), "'hair' is a sliver"),
    (with_part("cloud", APART, JointSpec(("body", "cloud"))), "'cloud' touches no other part"),
    (with_part("cloud", APART, JointSpec(("body", "cloud"))), "pixels apart"),
    (with_part("leg", LEG), "no joint ties 'leg' to the rest"),
    (with_part("leg", LEG, JointSpec(("body", "leg"), (90.0, 190.0))), "pixels outside 'body'"),
    (with_part("leg", LEG, JointSpec(("body", "leg")), JointSpec(("arm", "leg"))), "close 1 ring"),
    (with_part("leg", LEG, JointSpec(("body", "leg")), JointSpec(("leg", "body"))), "several joints"),
    (with_part("patch", bar(90, 150, 130, 180, (0, 0, 0)), JointSpec(("body", "patch"))), "touch but do not overlap"),
]


def test_a_sound_puppet_has_no_findings():
    assert check(two_parts(JOINT)) == []
    assert check(with_part("leg", LEG, JointSpec(("body", "leg")))) == []
    assert check(CutOut(SIZE, (Part("ball", disc(100.0, 100.0, 40.0, (9, 9, 9))),))) == []


@pytest.mark.parametrize(("cutout", "words"), FAULTS, ids=[words for _, words in FAULTS])
def test_a_fault_is_said_in_words(cutout, words):
    findings = check(cutout)
    assert any(words in finding for finding in findings), findings


def test_the_overlay_shows_parts_outlines_and_joints():
    cutout = two_parts(JOINT)
    puppet = build(cutout, PuppetSettings())
    picture = overlay(cutout, puppet)
    low, high = puppet.vertices.min(axis=0), puppet.vertices.max(axis=0)
    low, high = low - 0.06 * (high - low).max(), high + 0.06 * (high - low).max()
    scale = picture.shape[0] / (high - low)[1]
    assert picture.shape[1] == pytest.approx(2 * scale * (high - low)[0], abs=2)

    def at(x: float, y: float) -> list[int]:
        column, row = ((np.array([x, y]) - low) * scale).astype(int)
        return picture[row, column].tolist()

    assert at(70.0, 70.0) == [200, 40, 40]
    assert at(200.0, 100.0) == [40, 40, 200]
    assert at(*JOINT.at) == [0, 0, 0]
    assert at(39.7, 100.0) != at(30.0, 100.0)
