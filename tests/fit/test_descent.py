from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
import torch

from tests.scene_values import crops_of, true_vertices
from tests.scenes import make_scene
from wildpuppet.fit.curvature import Bones
from wildpuppet.fit.descent import LOSS_NAMES, Problem, descend, energies, make_problem
from wildpuppet.fit.target import target_at
from wildpuppet.puppet.build import build
from wildpuppet.settings import FitSettings, PuppetSettings
from wildpuppet.types import Puppet

torch.set_num_threads(1)
FRAMES = [3, 12]
ALL = FitSettings()
ONLY = {"reconstruction": 0.0, "arap": 0.0, "joints": 0.0, "area": 0.0}


@pytest.fixture(scope="module")
def puppet_and_truth() -> tuple[Puppet, Callable[[FitSettings, float], Problem], torch.Tensor]:
    """A figure in two frames; the problem at half size for settings and a size it is expected to have; the truth."""
    scene = make_scene("crossing", size=(192, 144))
    puppet = build(scene.cutout, PuppetSettings(edge=0.1))
    true = torch.from_numpy(0.5 * true_vertices(scene, puppet)[FRAMES]).float()
    images = np.asarray(crops_of(scene).images)[FRAMES]

    def problem(settings: FitSettings, expected: float = 1.0) -> Problem:
        target = target_at(images, 0.5, settings.matte * settings.robust**2)
        return make_problem(puppet, target, scene.order[FRAMES], expected * true, settings)

    return puppet, problem, true


def smooth_field(vertices: torch.Tensor, seed: int) -> torch.Tensor:
    """Waves longer than the triangles, about one pixel high."""
    draw = np.random.default_rng(seed)
    places, waves = vertices.numpy(), draw.normal(0, 0.12, (2, 2, 3))
    phases = draw.uniform(0, 6, (2, 3))
    field = np.stack([np.sin(places @ waves[axis] + phases[axis]).sum(-1) for axis in (0, 1)], -1)
    return torch.from_numpy(field / np.sqrt(1.5)).float()


CASES = {
    "everything but area": (FitSettings(area=0.0), 1.0),
    # the expected size is out of reach of the frame's own, so it stands still: else area has no exact gradient
    "everything": (ALL, 0.85),
    "reconstruction": (FitSettings(**{**ONLY, "reconstruction": 1.0}), 1.0),
    "arap": (FitSettings(**{**ONLY, "arap": ALL.arap}), 1.0),
    "joints": (FitSettings(**{**ONLY, "joints": ALL.joints}), 1.0),
    "area": (FitSettings(**{**ONLY, "area": ALL.area}), 0.85),
}


@pytest.mark.parametrize("case", CASES)
def test_gradient_matches_finite_differences_of_the_robust_energy(puppet_and_truth, case):
    """The weights that are held fixed are the robust function's slopes, so this is its whole gradient.

    Differences over 0.04 pixels meet the kinks of a bilinear texture, which change a slope by about one in a hundred;
    the other terms are smooth, and single precision is what is left.
    """
    _, problem_for, true = puppet_and_truth
    problem = problem_for(*CASES[case])
    vertices = true + smooth_field(true, 0)
    _, gradient, _ = energies(problem, vertices)
    step, tolerance = 0.02, 0.01 if problem.settings.reconstruction else 1e-3
    steepest = gradient / gradient.norm(dim=-1).amax(1)[:, None, None]
    for field in (steepest, smooth_field(true, 1), smooth_field(true, 2)):
        ahead, behind = (energies(problem, vertices + sign * step * field)[0] for sign in (1, -1))
        expected = (ahead - behind) / (2 * step)
        size = (gradient.norm(dim=-1) * field.norm(dim=-1)).sum(1)  # nothing cancels: what tolerances are shares of
        torch.testing.assert_close(
            (gradient * field).sum((1, 2)) / size, expected / size, rtol=tolerance, atol=tolerance
        )


def test_terms_add_up_to_the_whole(puppet_and_truth):
    _, problem_for, true = puppet_and_truth
    total, _, terms = energies(problem_for(ALL), true + smooth_field(true, 0))
    assert set(terms) == set(LOSS_NAMES)
    assert all((value >= 0).all() for value in terms.values())
    weighted = [getattr(ALL, name, ALL.reconstruction) * terms[name] for name in LOSS_NAMES]
    torch.testing.assert_close(total, torch.stack(weighted).sum(0))


def test_a_rigid_rest_pose_costs_nothing_but_its_picture(puppet_and_truth):
    puppet, problem_for, _ = puppet_and_truth
    problem = problem_for(ALL)
    cos, sin = 0.6 * problem.scale[0].item(), 0.8 * problem.scale[0].item()
    turned = torch.from_numpy(puppet.vertices).float() @ torch.tensor([[cos, sin], [-sin, cos]]) + 3.0
    _, _, terms = energies(problem, turned.expand(2, -1, -1))
    for name in ("arap", "joints"):
        assert terms[name].max() < 1e-5, name
    assert terms["area"].max() < 1.0  # squared pixels
    assert terms["reconstruction"].min() > 100.0


def test_truth_costs_less_than_what_is_near(puppet_and_truth):
    _, problem_for, true = puppet_and_truth
    problem = problem_for(ALL)
    at_truth = energies(problem, true)[0]
    for shift in ((0.7, 0.0), (-0.7, 0.0), (0.0, 0.7), (0.0, -0.7)):
        assert (energies(problem, true + torch.tensor(shift))[0] > 1.3 * at_truth).all()


def test_each_frame_has_an_energy_of_its_own(puppet_and_truth):
    _, problem_for, true = puppet_and_truth
    problem, moved = problem_for(ALL), true.clone()
    moved[1] += 2.0
    before, gradient, _ = energies(problem, true)
    after, other, _ = energies(problem, moved)
    assert after[0] == before[0]
    assert after[1] > before[1]
    torch.testing.assert_close(gradient[0], other[0])


@pytest.mark.parametrize("with_mesh", [False, True])
def test_energy_never_rises(puppet_and_truth, with_mesh):
    puppet, problem_for, true = puppet_and_truth
    problem, start = problem_for(ALL), true + 1.5 * smooth_field(true, 4)
    bones = Bones(puppet.layer_of_vertex, puppet, ALL.hold_scale)
    path = [energies(problem, descend(problem, start, steps, bones, with_mesh))[0] for steps in (0, 1, 2, 4, 8, 16)]
    torch.testing.assert_close(path[0], energies(problem, start)[0])
    for before, after in pairwise(path):
        assert (after <= before).all()
    assert (path[-1] < 0.8 * path[0]).all()


def test_descent_finds_shifted_parts(puppet_and_truth):
    puppet, problem_for, true = puppet_and_truth
    turns = torch.from_numpy(np.random.default_rng(0).uniform(0, 2 * np.pi, (2, puppet.num_layers))).float()
    shifts = 1.2 * torch.stack([turns.cos(), turns.sin()], -1)
    start = true + shifts[:, torch.from_numpy(puppet.layer_of_vertex)]
    bones = Bones(puppet.layer_of_vertex, puppet, ALL.hold_scale)
    found = descend(problem_for(ALL), start, 25, bones, with_mesh=False)
    assert ((found - true).norm(dim=-1).median(1).values < 0.25 * 1.2).all()
