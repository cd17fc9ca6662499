from pathlib import Path

from tests.puppet.test_build import bar
from wildpuppet.puppet.folder import read_cutout
from wildpuppet.puppet.imports.hinges import completed
from wildpuppet.types import JointSpec, Part

EXAMPLES = Path(__file__).parents[3] / "examples"


def part(name: str, *box: int) -> Part:
    return Part(name, bar(*box, (200, 40, 40)))


TORSO = part("torso", 40, 40, 100, 140)
UPPER = part("upper arm", 90, 50, 150, 70)
FORE = part("forearm", 140, 45, 200, 75)
CLOUD = part("cloud", 10, 170, 30, 190)


def pairs(joints: tuple[JointSpec, ...]) -> list[tuple[str, str]]:
    return [joint.parts for joint in joints]


def test_overlaps_make_a_tree_and_parts_alone_are_told() -> None:
    joints, notes = completed([TORSO, UPPER, FORE, CLOUD], (), [()] * 4)
    assert pairs(joints) == [("torso", "upper arm"), ("upper arm", "forearm")]
    assert all(joint.at is None for joint in joints)
    assert "2 guessed" in notes[0]
    assert "touch no others" in notes[1]


def test_given_hinges_stay_and_only_what_is_loose_is_tied() -> None:
    given = (JointSpec(("forearm", "torso"), (100.0, 60.0)),)
    joints, notes = completed([TORSO, UPPER, FORE], given, [()] * 3)
    assert joints[0] == given[0]
    assert pairs(joints)[1:] == [("torso", "upper arm")]
    assert "the file's hinges do not tie all parts" in notes[0]
    full = (JointSpec(("torso", "upper arm")), JointSpec(("upper arm", "forearm")))
    assert completed([TORSO, UPPER, FORE], full, [()] * 3) == (full, ())


def test_a_part_that_lies_on_others_hangs_on_one_of_them() -> None:
    eye = part("eye", 120, 55, 124, 60)
    joints, _ = completed([TORSO, UPPER, eye], (), [()] * 3)
    assert ("upper arm", "eye") in pairs(joints)


def test_parts_that_only_touch_are_tied_and_parts_two_pixels_apart_are_not() -> None:
    left, right, apart = part("left", 20, 20, 60, 60), part("right", 61, 20, 99, 60), part("apart", 104, 20, 140, 60)
    assert pairs(completed([left, right, apart], (), [()] * 3)[0]) == [("left", "right")]


def test_groups_in_common_come_first() -> None:
    """The hand overlaps the body more than the arm; that it shares the arm's group decides."""
    hand = part("hand", 80, 60, 100, 80)
    arm = part("arm", 92, 50, 150, 70)
    loose, _ = completed([TORSO, arm, hand], (), [()] * 3)
    assert ("torso", "hand") in pairs(loose)
    grouped, _ = completed([TORSO, arm, hand], (), [(), ("limb",), ("limb",)])
    assert ("arm", "hand") in pairs(grouped)


def test_most_of_the_examples_joints_are_found() -> None:
    right = total = 0
    for name in ("bluto", "bunny", "gbot"):
        cutout = read_cutout(EXAMPLES / name / "puppet")
        truth = {frozenset(joint.parts) for joint in cutout.joints}
        found, _ = completed(cutout.parts, (), [()] * len(cutout.parts))
        right += len(truth & {frozenset(joint.parts) for joint in found})
        total += len(truth)
    assert right >= 0.75 * total
