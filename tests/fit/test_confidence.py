"""Confidence on a drawn figure: fits that are the truth, and the truth with something deliberately wrong."""

import dataclasses

import numpy as np
import pytest

from tests.fit.test_fit import Case, drawn
from wildpuppet.fit.calibration import WEIGHTS, probability
from wildpuppet.fit.confidence import with_confidence
from wildpuppet.fit.signs import HIGH, LOW, NAMES
from wildpuppet.machine import Machine
from wildpuppet.pose.place import pose_vertices
from wildpuppet.types import Fit, Hypotheses, Poses

FRAMES = 5
ARM = ("right_upper_arm", "right_forearm")
WORSE, BETTER = 3.0, -0.3
"""Cost of the rival pose against the truth's."""


@pytest.fixture(scope="module")
def walk() -> Case:
    case = drawn("walk", FRAMES)
    apart = dataclasses.replace(case.crops, drawing=np.arange(FRAMES))
    return dataclasses.replace(case, crops=apart)


def fit_at(case: Case, maps: np.ndarray) -> Fit:
    vertices = pose_vertices(case.puppet, maps).astype(np.float32)
    ones = np.ones(vertices.shape[:2], np.float32)
    return Fit(case.crops.frames, vertices, case.scene.order, ones, ("fitted",) * FRAMES)


def trusted(case: Case, fit: Fit, poses: Poses, rival: np.ndarray | None = None, cost: float = WORSE) -> Fit:
    """Judge a fit that began with ``poses``, beside another hypothesis of so much more ``cost``."""
    maps = np.stack([poses.crop_from_canvas, poses.crop_from_canvas if rival is None else rival], 1)
    order = np.repeat(poses.order[:, None], 2, 1)
    hypotheses = Hypotheses(maps, order, np.tile([1.0, 1.0 + cost], (FRAMES, 1)))
    return with_confidence(case.puppet, case.crops, hypotheses, poses, fit, Machine(workers=1))


def of_part(case: Case, fit: Fit, *names: str) -> np.ndarray:
    layers = [case.scene.layer(name) for name in names]
    return fit.confidence[:, np.isin(case.puppet.layer_of_vertex, layers)].mean(1)


def arm_moved(case: Case, maps: np.ndarray, frames: slice, by: float) -> np.ndarray:
    moved = maps.copy()
    for name in ARM:
        moved[frames, case.scene.layer(name), 0, 2] -= by
    return moved


def test_a_true_fit_is_trusted_and_a_misplaced_limb_is_not(walk):
    poses = walk.poses()
    right = trusted(walk, fit_at(walk, poses.crop_from_canvas), poses)
    assert right.state == ("fitted",) * FRAMES
    assert np.average(right.confidence) > 0.9
    wrong_maps = arm_moved(walk, poses.crop_from_canvas, slice(2, 3), 30.0)
    wrong = trusted(walk, fit_at(walk, wrong_maps), dataclasses.replace(poses, crop_from_canvas=wrong_maps))
    assert of_part(walk, wrong, *ARM)[2] < 0.3 < 0.8 < of_part(walk, right, *ARM)[2]
    assert wrong.state == ("fitted", "fitted", "doubtful", "fitted", "fitted")
    feet = ("right_shin", "left_shin")
    np.testing.assert_allclose(of_part(walk, wrong, *feet), of_part(walk, right, *feet), atol=0.1)
    assert np.argmin(wrong.confidence.mean(1)) == 2


def test_a_rival_that_costs_no_more_takes_trust_from_what_it_moves(walk):
    poses = walk.poses()
    fit = fit_at(walk, poses.crop_from_canvas)
    rival = arm_moved(walk, poses.crop_from_canvas, slice(None), 30.0)
    sure, torn = (trusted(walk, fit, poses, rival, cost) for cost in (WORSE, BETTER))
    assert (of_part(walk, torn, *ARM) < of_part(walk, sure, *ARM) - 0.02).all()
    for name in ("head", "left_shin"):
        np.testing.assert_array_equal(of_part(walk, torn, name), of_part(walk, sure, name))


def test_a_jump_there_and_back_takes_trust_but_not_across_a_cut_nor_between_unordered_drawings(walk):
    poses = walk.poses()
    vertices = fit_at(walk, poses.crop_from_canvas).vertices_crop.copy()
    vertices[3:] += 30.0  # what was seen in frame 2 is judged against neighbours far off
    fit = dataclasses.replace(fit_at(walk, poses.crop_from_canvas), vertices_crop=vertices)

    def frame(**changes: object) -> float:
        case = dataclasses.replace(walk, crops=dataclasses.replace(walk.crops, **changes))
        return float(trusted(case, fit, poses).confidence[2].mean())

    alone = frame(ordered=False, reference=None)
    assert frame() < alone - 0.02
    assert frame(shot=np.array([0, 0, 0, 1, 1])) > frame()


def test_lost_frames_are_not_trusted_and_nothing_else_changes(walk):
    poses = walk.poses()
    fit = dataclasses.replace(
        fit_at(walk, poses.crop_from_canvas),
        state=("fitted", "lost", "held", "fitted", "fitted"),
        losses={"a": np.ones(5)},
    )
    found = trusted(walk, fit, poses)
    assert found.state == fit.state
    assert (found.confidence[1] == 0).all()
    assert found.vertices_crop is fit.vertices_crop
    assert found.losses is fit.losses


def test_every_sign_speaks_for_a_vertex():
    assert tuple(WEIGHTS) == NAMES
    middle = (LOW + HIGH) / 2
    odds = probability(middle) / (1 - probability(middle))
    for index, name in enumerate(NAMES):
        more = middle.copy()
        more[index] = HIGH[index]
        ratio = probability(more) / (1 - probability(more)) / odds
        assert ratio >= 1
        assert np.log(ratio) == pytest.approx(WEIGHTS[name] * (HIGH[index] - middle[index]))
    assert probability(np.stack([LOW, HIGH])).tolist() == pytest.approx([0.0, 1.0], abs=0.02)
