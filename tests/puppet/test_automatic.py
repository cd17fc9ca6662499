import cv2
import numpy as np
import pytest

from wildpuppet.errors import InputError
from wildpuppet.puppet.automatic import automatic
from wildpuppet.puppet.build import build
from wildpuppet.puppet.check import check
from wildpuppet.settings import AutoSettings, PuppetSettings
from wildpuppet.types import CutOut

JOINT_PIXELS = 22.0
"""A hip or shoulder is anywhere in a thick limb's root; this is less than the limbs' width."""
LEAST_OVERLAP = 0.97
"""Intersection over union of the drawn silhouette and the found one: at most its rim differs."""
SKIN, SHIRT, TROUSERS, FUR = (240, 190, 150), (200, 60, 50), (50, 50, 120), (150, 90, 40)

Drawing = tuple[np.ndarray, np.ndarray, tuple[float, float, float, float]]


def paint(strokes: list[tuple], background: np.ndarray | None = None) -> Drawing:
    """Draw lines (from, to, width, colour) and ellipses (centre, axes, angle, colour); returns rgb, mask and box."""
    rgb = np.full((360, 400, 3), (120, 160, 200), np.uint8) if background is None else background.copy()
    rgb[280:] = (90, 140, 80)
    mask = np.zeros((360, 400), np.uint8)
    for stroke in strokes:
        for picture, color in ((rgb, stroke[3]), (mask, 255)):
            if isinstance(stroke[2], int) and len(stroke) == 4 and not isinstance(stroke[1][0], float):
                cv2.line(picture, stroke[0], stroke[1], color, stroke[2], cv2.LINE_AA)
            else:
                axes = int(stroke[1][0]), int(stroke[1][1])
                cv2.ellipse(picture, stroke[0], axes, stroke[2], 0, 360, color, -1, cv2.LINE_AA)
    rows, columns = np.nonzero(mask)
    x, y = columns.min() - 3.0, rows.min() - 3.0
    return rgb, mask > 127, (x, y, columns.max() + 4.0 - x, rows.max() + 4.0 - y)


def humanoid() -> Drawing:
    return paint(
        [
            ((170, 120), (90, 150), 24, SKIN),
            ((90, 150), (70, 220), 22, SKIN),
            ((230, 120), (310, 110), 24, SKIN),
            ((310, 110), (350, 50), 22, SKIN),
            ((185, 200), (150, 320), 30, TROUSERS),
            ((215, 200), (250, 320), 30, TROUSERS),
            ((200, 160), (42.0, 65.0), 0, SHIRT),
            ((200, 60), (38.0, 38.0), 0, SKIN),
            ((200, 90), (200, 110), 22, SKIN),
        ]
    )


def quadruped() -> Drawing:
    legs = [((x, 190), (x + dx, 310), 24, FUR) for x, dx in ((120, -10), (160, 8), (260, -8), (295, 12))]
    body = [((205, 170), (110.0, 48.0), 0, FUR), ((300, 150), (335, 100), 34, FUR), ((345, 85), (36.0, 24.0), 20, FUR)]
    return paint([*legs, *body, ((105, 150), (40, 90), 16, FUR)])


def blob() -> Drawing:
    return paint([((200, 180), (90.0, 70.0), 20, (200, 40, 160))])


def union(cutout: CutOut) -> np.ndarray:
    return np.max([part.rgba[..., 3] for part in cutout.parts], axis=0) >= 128


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def nearest_joint(cutout: CutOut, place: tuple[float, float]) -> float:
    return min(float(np.hypot(joint.at[0] - place[0], joint.at[1] - place[1])) for joint in cutout.joints)


HUMAN_JOINTS = [(90, 150), (310, 110), (165, 122), (232, 120), (187, 208), (213, 208), (200, 105)]
BEAST_JOINTS = [(120, 205), (161, 210), (259, 210), (296, 205), (300, 150), (103, 150)]


@pytest.mark.parametrize(
    ("drawing", "joints", "names"),
    [
        (humanoid(), HUMAN_JOINTS, {"body", "head", "arm_left", "arm_right", "leg_left", "leg_right"}),
        (quadruped(), BEAST_JOINTS, {"body", "head", "arm", "leg_1", "leg_2", "leg_3", "leg_4"}),
        (blob(), [], {"body"}),
    ],
    ids=["humanoid", "quadruped", "blob"],
)
def test_bodies_get_their_limbs(drawing, joints, names):
    rgb, mask, box = drawing
    cutout = automatic(rgb, None, box, AutoSettings())
    assert overlap(union(cutout), mask) >= LEAST_OVERLAP
    assert names <= {part.name for part in cutout.parts}
    assert len(cutout.joints) == len(cutout.parts) - 1
    for place in joints:
        assert nearest_joint(cutout, place) <= JOINT_PIXELS, place
    assert check(cutout) == []
    assert build(cutout, PuppetSettings()).canvas == (400, 360)


@pytest.fixture(scope="module")
def person() -> CutOut:
    rgb, _, box = humanoid()
    return automatic(rgb, None, box, AutoSettings())


def test_parts_show_the_frame_and_overlap_by_a_disc_at_each_joint(person):
    rgb, cutout = humanoid()[0], person
    parts = {part.name: part.rgba for part in cutout.parts}
    for joint in cutout.joints:
        x, y = (int(value) for value in joint.at)
        disc = np.hypot(np.arange(400) - x, np.arange(360)[:, None] - y) <= 8.0
        for name in joint.parts:
            assert (parts[name][..., 3][disc] == 255).all()
    shown = np.zeros_like(rgb)
    for part in cutout.parts:  # back to front: at rest the puppet is the frame
        shown[part.rgba[..., 3] == 255] = part.rgba[part.rgba[..., 3] == 255, :3]
    inside = cv2.erode(union(cutout).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    np.testing.assert_array_equal(shown[inside], rgb[inside])
    body = parts["body"]
    shoulder = body[118:126, 170:178]
    assert (shoulder[..., 3] == 255).all()
    assert np.abs(shoulder[..., :3].astype(int) - SHIRT).max() <= 40  # its own colour, not the arm's


def test_a_matte_that_knows_nothing_changes_nothing_and_the_answer_repeats(person):
    rgb, _, box = humanoid()
    again = automatic(rgb, np.full(rgb.shape[:2], 128, np.uint8), box, AutoSettings())
    assert person.joints == again.joints
    for one, other in zip(person.parts, again.parts, strict=True):
        np.testing.assert_array_equal(one.rgba, other.rgba)


def test_the_number_and_length_of_limbs_are_bounded():
    rgb, _, box = humanoid()
    assert len(automatic(rgb, None, box, AutoSettings(most_parts=4)).parts) == 4
    assert len(automatic(rgb, None, box, AutoSettings(least_limb=0.9)).parts) == 1


def test_a_matte_finds_what_colour_hides():
    rgb, mask, box = humanoid()
    hidden = rgb.copy()
    hidden[200:280][mask[200:280]] = (120, 160, 200)
    hidden[280:][mask[280:]] = (90, 140, 80)
    noise = np.random.default_rng(0).random(mask.shape)
    matte = np.where(noise < 0.3, 128, np.where(mask, 255, 0)).astype(np.uint8)
    without = overlap(union(automatic(hidden, None, box, AutoSettings())), mask)
    assert overlap(union(automatic(hidden, matte, box, AutoSettings())), mask) >= 0.9 > without


def test_a_background_object_cut_by_the_box_is_left_out():
    background = np.full((360, 400, 3), (120, 160, 200), np.uint8)
    cv2.rectangle(background, (0, 60), (150, 160), (230, 220, 90), -1)
    rgb, mask, box = paint([((200, 180), (90.0, 70.0), 20, (200, 40, 160))], background)
    assert overlap(union(automatic(rgb, None, box, AutoSettings())), mask) >= LEAST_OVERLAP


def test_a_featureless_frame_still_gives_one_part():
    cutout = automatic(np.full((80, 90, 3), 77, np.uint8), None, (20.0, 10.0, 40.0, 60.0), AutoSettings())
    assert [part.name for part in cutout.parts] == ["body"]
    rows, columns = np.nonzero(union(cutout))
    assert rows.min() >= 10
    assert columns.max() < 60
    automatic(np.full((80, 90, 3), 77, np.uint8), None, (-5.0, -5.0, 200.0, 200.0), AutoSettings())


def test_a_box_outside_the_frame_is_refused():
    with pytest.raises(InputError, match="90 x 80 frame"):
        automatic(np.zeros((80, 90, 3), np.uint8), None, (88.0, 10.0, 40.0, 60.0), AutoSettings())
