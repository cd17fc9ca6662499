"""Handles: the energy against its parts, both solvers against closed forms and against each other."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.motion.dolls import Doll, arm
from wildpuppet.fit.energy import joint_distance
from wildpuppet.fit.handles import DeformEnergy, Handles, deform_energy, joint_rows
from wildpuppet.fit.pull_codes import Subspace, decode_with_jacobian, plain_steps, pull_codes
from wildpuppet.fit.pull_vertices import HOLD, pull_vertices, settle
from wildpuppet.geometry.arap import arap_energy

torch.set_num_threads(1)
UNIT = 2 / 280
SHIFT = np.array([8.0, -6.0])
BENT = {"upper": 0.3, "lower": -0.7}


@pytest.fixture(scope="module")
def doll() -> Doll:
    return arm()


def handle_at(doll: Doll, part: str, at: tuple[float, float], target: tuple[float, float]) -> Handles:
    """A handle at the corner of the part that is nearest to ``at`` on the puppet at rest."""
    mine = np.flatnonzero(doll.puppet.layer_of_vertex == doll.puppet.names.index(part))
    nearest = mine[np.linalg.norm(doll.puppet.vertices[mine] - at, axis=1).argmin()]
    triangle = doll.puppet.triangles[(doll.puppet.triangles == nearest).any(1)][:1]
    return Handles(triangle.astype(np.int64), (triangle == nearest).astype(np.float64), np.array([target]))


def both(first: Handles, second: Handles) -> Handles:
    pairs = zip(
        (first.corners, first.weights, first.targets), (second.corners, second.weights, second.targets), strict=True
    )
    return Handles(*(np.concatenate(pair) for pair in pairs))


def energy_of(doll: Doll, handles: Handles, rest: np.ndarray | None = None) -> DeformEnergy:
    return deform_energy(doll.puppet, doll.puppet.vertices if rest is None else rest, handles, UNIT)


def test_the_energy_is_the_papers_sum(doll: Doll) -> None:
    handles = handle_at(doll, "lower", (220, 100), (180.0, 160.0))
    pose = doll.posed(BENT) + np.random.default_rng(0).normal(0, 2.0, doll.puppet.vertices.shape)
    terms = energy_of(doll, handles).terms(pose.reshape(-1) * UNIT)
    rest, posed = (torch.from_numpy(np.array(each, np.float64))[None] * UNIT for each in (doll.puppet.vertices, pose))
    rigid = arap_energy(posed, rest[0], torch.from_numpy(doll.puppet.triangles.astype(np.int64)))
    joints = joint_distance(
        posed, torch.from_numpy(doll.puppet.joint_vertices).long(), torch.from_numpy(doll.puppet.joint_weights).double()
    )
    assert terms["user"] == pytest.approx(((handles.missing(pose) * UNIT) ** 2).sum())
    assert terms["rigid"] == pytest.approx(25 * float(rigid))
    assert terms["joints"] == pytest.approx(50 * float(joints))


def test_gradient_and_rows_agree_with_finite_differences(doll: Doll) -> None:
    generator = np.random.default_rng(1)
    energy = energy_of(doll, handle_at(doll, "lower", (220, 100), (180.0, 160.0)))
    x = (doll.posed(BENT).reshape(-1) + generator.normal(0, 2.0, doll.puppet.vertices.size)) * UNIT
    along = generator.normal(size=len(x))
    step = 1e-6 * along
    slope = (energy.value(x + step) - energy.value(x - step)) / 2e-6
    assert energy.gradient(x) @ along == pytest.approx(slope, rel=1e-6)
    rows = energy.rows(x)
    assert rows.residual @ rows.residual == pytest.approx(energy.value(x))
    moved = (energy.rows(x + step).residual - energy.rows(x - step).residual) / 2e-6
    np.testing.assert_allclose(rows.jacobian @ along, moved, atol=1e-5)


def test_open_hinges_cost_what_they_open_beyond_the_undeformed_shape(doll: Doll) -> None:
    apart = doll.posed(BENT)
    apart[doll.puppet.layer_of_vertex == doll.puppet.names.index("lower")] += [3.0, -4.0]
    handles = handle_at(doll, "upper", (70, 100), (0.0, 0.0))
    reached = replace(handles, targets=handles.points(apart))
    x = apart.reshape(-1) * UNIT
    assert energy_of(doll, reached, apart).value(x) < 1e-12
    num_joints = len(doll.puppet.joint_layers)
    assert energy_of(doll, reached).terms(x)["joints"] == pytest.approx(50 * num_joints * (5 * UNIT) ** 2, rel=1e-4)


def test_turned_and_shifted_parts_cost_nothing(doll: Doll) -> None:
    pose = doll.posed(BENT, (30.0, -12.0))
    handles = handle_at(doll, "lower", (220, 100), (0.0, 0.0))
    reached = replace(handles, targets=handles.points(pose))
    assert energy_of(doll, reached).value(pose.reshape(-1) * UNIT) < 1e-6  # hinges are a float32 mix of vertices


def test_a_stiff_puppet_is_shifted_as_the_balance_of_pull_and_hold_says(doll: Doll) -> None:
    """Two equal handles about the centre of mass pull all of a rigid body by d = t n / (n + hold mass)."""
    free = replace(
        doll.puppet, joint_layers=doll.puppet.joint_layers[:0], joint_vertices=doll.puppet.joint_vertices[:0],
        joint_weights=doll.puppet.joint_weights[:0],
    )  # fmt: skip
    every = np.arange(len(free.vertices))
    handles = Handles(np.stack([every] * 3, 1), np.tile([1.0, 0.0, 0.0], (len(every), 1)), free.vertices + SHIFT)
    energy = deform_energy(free, free.vertices, handles, UNIT)
    hold = 50.0
    moved = pull_vertices(energy, free.vertices.astype(np.float64), hold) - free.vertices
    mass = energy.mass[::2]
    share = len(every) / (len(every) + hold * mass.sum())
    np.testing.assert_allclose(moved.mean(0), SHIFT * share, rtol=0.05)
    assert energy.terms((free.vertices + moved).reshape(-1) * UNIT)["rigid"] < 1e-3


def test_the_baseline_ends_where_nothing_pulls(doll: Doll) -> None:
    """Its slope, by finite differences, is zero; and from the answer it does not move."""
    energy = energy_of(doll, handle_at(doll, "lower", (220, 100), (200.0, 140.0)))
    start = doll.puppet.vertices.astype(np.float64)
    found = pull_vertices(energy, start)
    first, held = start.reshape(-1) * UNIT, HOLD * energy.mass

    def total(x: np.ndarray) -> float:
        return energy.value(x) + float(held @ (x - first) ** 2)

    x, generator = found.reshape(-1) * UNIT, np.random.default_rng(0)
    for _ in range(5):
        along = generator.normal(size=len(x))
        along /= np.linalg.norm(along)
        assert abs(total(x + 1e-4 * along) - total(x - 1e-4 * along)) / 2e-4 < 1e-4
        assert total(x + 1e-3 * along) > total(x)
    assert energy.terms(x)["user"] < 0.5 * energy.terms(first)["user"]


def test_settling_meets_handles_and_keeps_hinges(doll: Doll) -> None:
    pose = doll.posed(BENT)
    handles = both(handle_at(doll, "lower", (220, 100), (0.0, 0.0)), handle_at(doll, "upper", (70, 100), (0.0, 0.0)))
    handles = replace(handles, targets=handles.points(pose) + np.array([[2.0, -3.0], [-1.5, 0.5]]))
    found = settle(deform_energy(doll.puppet, pose, handles, UNIT), pose)
    assert handles.missing(found).max() < 1e-4
    hinges = joint_rows(doll.puppet)
    np.testing.assert_allclose(hinges @ found, hinges @ pose, atol=1e-4)
    energy = deform_energy(doll.puppet, pose, handles, UNIT)
    dent = pose.copy()  # the crudest way to meet them: the handles' own vertices alone
    for corners, weights, missing in zip(
        handles.corners, handles.weights, handles.targets - handles.points(pose), strict=True
    ):
        dent[corners[weights.argmax()]] += missing
    rigid = [energy.terms(each.reshape(-1) * UNIT)["rigid"] for each in (found, dent)]
    assert rigid[0] < 0.3 * rigid[1]
    far = np.linalg.norm(pose - pose[doll.puppet.layer_of_vertex == 0].mean(0), axis=1) < 15
    assert np.linalg.norm(found - pose, axis=1)[far].max() < 2.0


def test_targets_that_contradict_are_met_on_average(doll: Doll) -> None:
    pose = doll.posed({})
    one = handle_at(doll, "lower", (220, 100), (0.0, 0.0))
    at = one.points(pose)[0]
    handles = both(replace(one, targets=at[None] + [2.0, 0.0]), replace(one, targets=at[None] + [0.0, 2.0]))
    found = settle(deform_energy(doll.puppet, pose, handles, UNIT), pose)
    np.testing.assert_allclose(handles.points(found)[0] - at, [1.0, 1.0], atol=0.01)


class Sliding:
    """Codes (a, b) shift all vertices by a along x and b along y."""

    def __init__(self, rest: np.ndarray) -> None:
        self.rest = torch.from_numpy(np.array(rest, np.float64))

    def decode_tensor(self, codes: torch.Tensor) -> torch.Tensor:
        return self.rest + codes[:, None]


class Turning:
    """Code (a,) turns all vertices about a point."""

    def __init__(self, rest: np.ndarray, centre: tuple[float, float]) -> None:
        self.rest, self.centre = torch.from_numpy(np.array(rest, np.float64)), torch.tensor(centre, dtype=torch.float64)

    def decode_tensor(self, codes: torch.Tensor) -> torch.Tensor:
        cos, sin = codes.cos(), codes.sin()
        x, y = (self.rest - self.centre).T
        return torch.stack([cos * x - sin * y, sin * x + cos * y], -1) + self.centre


def test_codes_balance_handles_and_known_poses(doll: Doll) -> None:
    """One direction of 10 pixels: y minimises (10 u y - t u)^2 + spread^2 y^2."""
    rest = doll.puppet.vertices.astype(np.float64)
    handles = handle_at(doll, "lower", (220, 100), (0.0, 0.0))
    handles = replace(handles, targets=handles.points(rest) + np.array([25.0, 7.0]))
    space = Subspace(np.zeros(2), np.array([[10.0, 0.0]]), 0.05)
    code = pull_codes(energy_of(doll, handles), Sliding(rest), space)
    y = (10 * UNIT * 25 * UNIT) / ((10 * UNIT) ** 2 + 0.05**2)
    np.testing.assert_allclose(code, [10 * y, 0.0], rtol=1e-3)


def test_gauss_newton_turns_to_the_handle(doll: Doll) -> None:
    rest = doll.puppet.vertices.astype(np.float64)
    decoder = Turning(rest, (60.0, 100.0))
    handles = handle_at(doll, "lower", (220, 100), (0.0, 0.0))
    handles = replace(
        handles, targets=handles.points(decoder.decode_tensor(torch.tensor([[1.1]], dtype=torch.float64))[0].numpy())
    )
    code = pull_codes(energy_of(doll, handles), decoder, Subspace(np.zeros(1), np.ones((1, 1)), 1e-4))
    assert code[0] == pytest.approx(1.1, abs=1e-4)


def test_forward_jacobian_is_that_of_finite_differences(doll: Doll) -> None:
    decoder = Turning(doll.puppet.vertices, (60.0, 100.0))
    vertices, moved = decode_with_jacobian(decoder, np.array([0.4]), np.array([[1.0], [-2.0]]))
    ahead, behind = (decode_with_jacobian(decoder, np.array([0.4 + e]), np.ones((1, 1)))[0] for e in (1e-5, -1e-5))
    slope = (ahead - behind) / 2e-5
    np.testing.assert_allclose(moved, np.stack([slope, -2 * slope], -1), atol=1e-5)
    np.testing.assert_allclose(vertices, (ahead + behind) / 2, atol=1e-6)


def test_a_plain_step_goes_down_the_slope(doll: Doll) -> None:
    decoder = Turning(doll.puppet.vertices, (60.0, 100.0))
    energy = energy_of(doll, handle_at(doll, "lower", (220, 100), (180.0, 160.0)))

    def total(angle: float) -> float:
        posed = decoder.decode_tensor(torch.tensor([[angle]], dtype=torch.float64))[0].numpy()
        return energy.value(posed.reshape(-1) * UNIT)

    slope = (total(0.2 + 1e-5) - total(0.2 - 1e-5)) / 2e-5
    assert plain_steps(energy, decoder, np.array([0.2]), steps=1)[0] == pytest.approx(0.2 - 3e-4 * slope, abs=1e-9)
    assert total(plain_steps(energy, decoder, np.array([0.2]))[0]) < total(0.2)
