import itertools

import numpy as np

from tests.pose.boxes import box_puppet, crops_around
from wildpuppet.geometry import affine
from wildpuppet.pose.hidden import INERTIA, STEADY, follow_hidden, steadiest_path
from wildpuppet.pose.shots import Shot, keep_orders
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Hypotheses, Poses

AT = (32.0, 15.0)
PUPPET = box_puppet([(30, 4, 4, 12), (18, 14, 28, 22)], [(1, 0, AT)])
"""A bar that turns behind a body: upright it sticks out at the top, hanging it is hidden."""
NUM = 7
SETTINGS = SearchSettings(box_pixels=48)


def pose(degrees: float) -> np.ndarray:
    turn = affine.similarity(np.ones(1), np.radians([degrees]), np.zeros((1, 2)))[0]
    turn[:, 2] = AT - turn[:, :2] @ AT
    return np.stack([turn, affine.scale_and_shift(1.0, (0.0, 0.0))])


def drawn(bars: list[slice]) -> Crops:
    """What is seen: the body, and the bar in these rows."""
    crops = crops_around(len(bars))
    for image, rows in zip(crops.images, bars, strict=True):
        image[14:36, 18:46] = (40, 160, 60, 255)
        image[rows, 30:34] = (200, 40, 40, 255)
    return crops


UPRIGHT, HANGING, NOTHING = slice(4, 14), slice(14, 26), slice(0)


def test_hidden_part_turns_on_evenly_and_stays_hidden():
    true = [0.0, 0.0, 150.0, 160.0, 170.0, 0.0, 0.0]
    crops = drawn([UPRIGHT if angle == 0 else NOTHING for angle in true])
    found = np.stack([pose(angle) for angle in [0.0, 0.0, 120.0, 240.0, 120.0, 0.0, 0.0]])
    order = np.tile([0, 1], (NUM, 1))
    poses = Poses(found, order, np.zeros(NUM), np.zeros(NUM))
    hypotheses = Hypotheses(np.stack([found, found], 1), np.stack([order, order], 1), np.zeros((NUM, 2)))
    steady = follow_hidden(PUPPET, crops, hypotheses, poses, SETTINGS).crop_from_canvas
    seen = [0, 1, 5, 6]
    np.testing.assert_array_equal(steady[seen], found[seen])
    angles = np.unwrap(np.arctan2(steady[1:6, 0, 1, 0], steady[1:6, 0, 0, 0]), period=2 * np.pi)
    before = np.unwrap(np.arctan2(found[1:6, 0, 1, 0], found[1:6, 0, 0, 0]), period=2 * np.pi)
    assert (np.diff(angles, 2) ** 2).sum() < 0.5 * (np.diff(before, 2) ** 2).sum()
    shot = Shot(PUPPET, crops, SETTINGS, np.arange(NUM), steady, order, np.zeros(NUM, bool))
    assert (shot.seen()[2:5, 0] < 0.1).all()
    fixed = Hypotheses(hypotheses.crop_from_canvas, hypotheses.order, np.tile([0.0, np.inf], (NUM, 1)))
    kept = follow_hidden(PUPPET, crops, fixed, poses, SETTINGS)
    np.testing.assert_array_equal(kept.crop_from_canvas, found)


def test_order_changes_once_for_what_many_drawings_say():
    """What one drawing says is less than the price of a change, what eight say is more."""
    is_front = [False] * 3 + [True] * 8
    crops = drawn([HANGING if front else NOTHING for front in is_front])
    maps = np.stack([pose(180.0)] * len(is_front))
    order = np.array([[0, 1], [1, 0], [0, 1], [0, 1], [1, 0], [1, 0], [0, 1], [1, 0], [1, 0], [0, 1], [1, 0]])
    shot = Shot(PUPPET, crops, SETTINGS, np.arange(len(order)), maps, order, np.zeros(len(order), bool))
    keep_orders(shot)
    assert shot.order.tolist() == [[1, 0] if front else [0, 1] for front in is_front]


def test_steadiest_path_is_the_best_of_all_paths():
    draw = np.random.default_rng(0)
    counts = (1, 3, 4, 2, 1)
    costs, angles = ([draw.uniform(low, high, n) for n in counts] for low, high in ((0, 1), (-3, 3)))

    def total(path: tuple[int, ...]) -> float:
        at = np.array([one[i] for one, i in zip(angles, path, strict=True)])
        turns = (np.diff(at) + np.pi) % (2 * np.pi) - np.pi
        own = sum(one[i] for one, i in zip(costs, path, strict=True))
        return float(own + STEADY * (turns**2).sum() + INERTIA * (np.diff(turns) ** 2).sum())

    best = min(itertools.product(*map(range, counts)), key=total)
    assert tuple(steadiest_path(costs, angles)) == best
