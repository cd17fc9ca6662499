import dataclasses

import numpy as np
import pytest
import torch

from tests.pose.boxes import box_puppet
from wildpuppet.fit.curvature import Bones, data_curvature, joint_matrix, mesh_inverse, stiffness_matrix
from wildpuppet.fit.energy import joint_distance
from wildpuppet.geometry.arap import arap_energy
from wildpuppet.render.texture import texture_at
from wildpuppet.types import Puppet

torch.set_num_threads(1)
PUPPET = box_puppet([(6, 6, 24, 12), (26, 8, 10, 30)], [(0, 1, (28.0, 13.0))])
TWO_HINGES = box_puppet([(6, 6, 24, 12), (26, 8, 10, 30)], [(0, 1, (28.0, 13.0)), (1, 0, (20.0, 17.0))])
NO_HINGES = box_puppet([(6, 6, 24, 12), (26, 8, 10, 30)])


def one_triangle(corners: np.ndarray) -> Puppet:
    whole = box_puppet([(6, 6, 24, 12)])
    return dataclasses.replace(
        whole, vertices=corners, uv=corners, triangles=np.array([[0, 1, 2]]), layer_of_vertex=np.zeros(3, np.int64)
    )


def random(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("scale", [1.0, 7.0])
def test_stiffness_of_one_triangle(scale):
    corners = scale * np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]])
    # gradients of the barycentrics are (-1/3, -1/4), (1/3, 0), (0, 1/4); the area is 6
    expected = 6 * np.array([[1 / 9 + 1 / 16, -1 / 9, -1 / 16], [-1 / 9, 1 / 9, 0], [-1 / 16, 0, 1 / 16]])
    np.testing.assert_allclose(stiffness_matrix(one_triangle(corners)), expected, atol=1e-12)
    np.testing.assert_allclose(stiffness_matrix(one_triangle(corners[[0, 2, 1]]))[1, 1], expected[2, 2])


def test_stiffness_is_symmetric_and_blind_to_shifts():
    matrix = stiffness_matrix(PUPPET)
    np.testing.assert_allclose(matrix, matrix.T)
    np.testing.assert_allclose(matrix.sum(1), 0, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -1e-9
    assert (matrix[:4, 4:] == 0).all()  # two layers


def test_stiffness_is_the_curvature_of_arap_against_stretching():
    """For a field u along x that bends nothing, E = sum A |grad u|^2 = u K u."""
    stretch = np.stack([PUPPET.vertices[:, 0], np.zeros(8)], 1)
    rest, triangles = torch.from_numpy(PUPPET.vertices), torch.from_numpy(PUPPET.triangles)
    moved = torch.from_numpy(PUPPET.vertices + 0.01 * stretch)[None]
    field = stretch[:, 0]
    expected = 0.01**2 * field @ stiffness_matrix(PUPPET) @ field
    assert arap_energy(moved, rest, triangles).item() == pytest.approx(expected)


@pytest.mark.parametrize("puppet", [NO_HINGES, PUPPET, TWO_HINGES], ids=["none", "one", "two"])
def test_joint_matrix_is_the_quadratic_form_of_the_gaps(puppet):
    vertices = random(8, 2)
    form = joint_matrix(puppet)
    gaps = joint_distance(
        torch.from_numpy(vertices)[None],
        torch.from_numpy(puppet.joint_vertices),
        torch.from_numpy(puppet.joint_weights),
    )
    assert np.einsum("vk,vw,wk->", vertices, form, vertices) == pytest.approx(gaps.item(), abs=1e-9)


def test_mesh_inverse_is_the_inverse():
    data = np.abs(random(8)) + 0.5
    stiffness, joints = 3 * stiffness_matrix(PUPPET), 2 * joint_matrix(PUPPET)
    product = mesh_inverse(data, stiffness, joints).numpy() @ (np.diag(data) + stiffness + joints)
    # vertices without data get a floor of a few hundredths of the mean
    np.testing.assert_allclose(product, np.eye(8), atol=0.1)


def test_mesh_inverse_moves_vertices_without_data_with_their_neighbours():
    data = np.zeros(8)
    data[0] = 1.0
    gradient = torch.zeros(8)
    gradient[0] = 1.0
    move = (mesh_inverse(data, 100 * stiffness_matrix(PUPPET), 100 * joint_matrix(PUPPET)) @ gradient).numpy()
    assert np.isfinite(move).all()
    np.testing.assert_allclose(move, move.mean(), rtol=0.05)


def test_data_curvature_counts_the_textures_slopes_once():
    texture = texture_at(PUPPET, 1.0)
    data = data_curvature(PUPPET, texture)
    assert data.shape == (8,)
    assert (data >= 0).all()
    assert data[4:].sum() > 0
    stronger = texture._replace(rgba=torch.cat([2 * texture.rgba[..., :3], texture.rgba[..., 3:]], -1))
    flat = texture._replace(rgba=torch.full_like(texture.rgba, 0.5))
    assert data_curvature(PUPPET, stronger).sum() > 1.5 * data.sum()
    np.testing.assert_allclose(data_curvature(PUPPET, flat), 0)


GROUPS = PUPPET.layer_of_vertex
WHOLE = np.zeros_like(GROUPS)


def posed(batch: int = 2) -> torch.Tensor:
    return torch.from_numpy(PUPPET.vertices + 3 * random(batch, 8, 2)).float()


def radius(points: np.ndarray) -> float:
    return float(np.sqrt((np.abs(points - points.mean(0)) ** 2).sum(-1).mean()))


@pytest.mark.parametrize("groups", [GROUPS, WHOLE], ids=["parts", "whole"])
def test_basis_is_the_derivative_of_moving_a_group(groups):
    vertices = posed()
    basis = Bones(groups, PUPPET, 0.0).basis(vertices).numpy()
    for b in range(2):
        for group in np.unique(groups):
            mine = groups == group
            points = vertices[b, mine].double().numpy()
            middle, size, step = points.mean(0), radius(points), 1e-4
            turn = step / size  # turns and scales are measured at the radius
            turned = middle + (points - middle) @ np.array(
                [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
            )
            scaled = middle + (points - middle) * (1 + turn)
            for column, moved in enumerate(
                (points + np.array([step, 0]), points + np.array([0, step]), turned, scaled)
            ):
                np.testing.assert_allclose(basis[b, mine, :, column], (moved - points) / step, atol=1e-3)


def least_squares_step(groups: np.ndarray, vertices: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """One step on 1/2 sum |v - target|^2, whose curvature is 1 per axis."""
    bones = Bones(groups, NO_HINGES, 0.0)
    return bones.step(vertices, vertices - target, torch.ones(8), 0.0, torch.zeros(len(vertices)))


FLOOR = 0.02
"""A step falls short by about one in a hundred: the curvature has a floor."""


def test_step_solves_a_shift_at_once():
    vertices, shift = posed(), torch.tensor([[[4.0, -7.0]], [[0.5, 2.0]]])
    move = least_squares_step(GROUPS, vertices, vertices + shift)
    torch.testing.assert_close(move, shift.expand(2, 8, 2), rtol=FLOOR, atol=FLOOR)


def test_step_solves_each_parts_small_turn_and_growth_at_once():
    vertices = posed()
    target = vertices.clone()
    for group, radians, growth in ((0, 0.02, 1.0), (1, -0.03, 1.02)):
        points = vertices[:, group == torch.from_numpy(GROUPS)]
        middle = points.mean(1, keepdim=True)
        cos, sin = growth * np.cos(radians), growth * np.sin(radians)
        turn = torch.tensor([[cos, -sin], [sin, cos]], dtype=torch.float32)
        target[:, group == torch.from_numpy(GROUPS)] = middle + (points - middle) @ turn.T
    move = least_squares_step(GROUPS, vertices, target)
    far = (target - vertices).norm(dim=-1).max()
    # beyond the floor, the chord of a small turn differs from its arc by its square
    torch.testing.assert_close(move, target - vertices, rtol=0, atol=float(0.03 * far))


def test_repeated_steps_find_the_closest_similarity():
    vertices, target = posed(1), posed(1) * 1.3 @ torch.tensor([[0.8, 0.6], [-0.6, 0.8]]) + 5
    for _ in range(60):
        vertices = vertices + least_squares_step(WHOLE, vertices, target)
    torch.testing.assert_close(vertices, target, rtol=0, atol=0.05)


def test_hinges_pull_the_other_part_along():
    vertices = torch.from_numpy(PUPPET.vertices).float()[None]
    gradient = torch.zeros_like(vertices)
    gradient[:, GROUPS == 0] = torch.tensor([-1.0, 0.0])
    data = torch.from_numpy(np.where(GROUPS == 0, 1.0, 1e-3)).float()  # only the first part sees anything
    loose, tied = (
        Bones(GROUPS, PUPPET, 0.0).step(vertices, gradient, data, weight, torch.zeros(1)) for weight in (0.0, 1e4)
    )
    assert loose[0, 4:].abs().max() < 0.01
    joint = PUPPET.joint_vertices[0], torch.from_numpy(PUPPET.joint_weights[0]).float()
    first, second = ((tied[0, torch.from_numpy(v)] * w[:, None]).sum(0) for v, w in zip(*joint, strict=True))
    torch.testing.assert_close(first, second, rtol=0, atol=0.01)
    assert first[0] > 0.3


def test_damping_and_held_scale_shorten_the_step():
    vertices = posed(1)
    gradient = vertices - (vertices.mean(1, keepdim=True) + 1.1 * (vertices - vertices.mean(1, keepdim=True)))

    def length(hold_scale: float, damping: float) -> float:
        bones = Bones(WHOLE, NO_HINGES, hold_scale)
        return float(bones.step(vertices, gradient, torch.ones(8), 0.0, torch.tensor([damping])).norm())

    assert length(0.0, 1.0) == pytest.approx(length(0.0, 0.0) / 2, rel=0.02)
    assert length(2.0, 0.0) < 0.5 * length(0.0, 0.0)
