import pytest
import torch

from wildpuppet.fit.energy import (
    from_unit,
    joint_distance,
    layer_area,
    mask_area,
    masked_reconstruction,
    reconstruction,
    to_unit,
)

torch.set_num_threads(1)
DOUBLE = torch.float64
SQUARE = torch.tensor([[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]], dtype=DOUBLE)
HALVES = torch.tensor([[0, 1, 2], [0, 2, 3]])


def random(*shape: int) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(0), dtype=DOUBLE)


def test_unit_coordinates_keep_angles_and_come_back():
    corners = torch.tensor([[0.0, 0.0], [200.0, 0.0], [100.0, 50.0], [200.0, 100.0]])
    expected = torch.tensor([[-1.0, -0.5], [1.0, -0.5], [0.0, 0.0], [1.0, 0.5]])
    torch.testing.assert_close(to_unit(corners, (200, 100)), expected)
    torch.testing.assert_close(from_unit(expected, (200, 100)), corners)


def test_masked_reconstruction_is_the_mean_square_under_the_mask():
    target = torch.full((2, 4, 5, 3), 100.0, dtype=DOUBLE)
    rendered = torch.zeros(2, 4, 5, 4, dtype=DOUBLE)
    rendered[0, 1:3, 2:4] = torch.tensor([90 / 255, 100 / 255, 100 / 255, 1.0], dtype=DOUBLE)
    rendered[1, :2, :2] = 0.5 * torch.tensor([100 / 255, 100 / 255, 130 / 255, 1.0], dtype=DOUBLE)
    target[:, 0, 4] = 3.0  # outside the mask: not seen
    # frame 0: one channel of three is 10 off. Frame 1: alpha 0.5, so 15 off, over half the mask's weight.
    expected = torch.tensor([10.0**2 / 3, 15.0**2 / (3 * 0.5)], dtype=DOUBLE)
    torch.testing.assert_close(masked_reconstruction(target, rendered), expected)


def test_masked_reconstruction_of_nothing_is_nothing():
    rendered = torch.zeros(1, 4, 5, 4, dtype=DOUBLE, requires_grad=True)
    loss = masked_reconstruction(255 * random(1, 4, 5, 3), rendered)
    loss.sum().backward()
    assert loss.item() == 0.0
    assert torch.isfinite(rendered.grad).all()


def test_reconstruction_composites_over_the_background():
    rendered = torch.zeros(1, 2, 2, 4, dtype=DOUBLE)
    rendered[0, 0, 0] = torch.tensor([0.5, 0.0, 0.0, 0.5], dtype=DOUBLE)
    background = torch.full((1, 1, 1, 3), 40.0, dtype=DOUBLE)
    target = torch.full((1, 2, 2, 3), 40.0, dtype=DOUBLE)
    expected = ((127.5 + 20 - 40) ** 2 + 2 * 20.0**2) / 12
    assert reconstruction(target, rendered, background).item() == pytest.approx(expected)


def test_joint_distance_is_the_squared_gap():
    vertices = torch.tensor([[[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [5.0, 1.0]]], dtype=DOUBLE)
    joint_vertices = torch.tensor([[[0, 1, 2], [3, 3, 3]]])
    joint_weights = torch.tensor([[[0.5, 0.25, 0.25], [1.0, 0.0, 0.0]]], dtype=DOUBLE)
    assert joint_distance(vertices, joint_vertices, joint_weights).item() == pytest.approx(4.5**2 + 0.5**2)
    assert joint_distance(vertices, joint_vertices[:0], joint_weights[:0]).item() == 0.0


def test_mask_area_is_the_squared_difference_in_pixels():
    alpha, initial = torch.ones(2, 4, 5, dtype=DOUBLE), torch.zeros(1, 4, 5, dtype=DOUBLE)
    initial[0, 0] = 1.0
    torch.testing.assert_close(mask_area(alpha, initial), torch.full((2,), 225.0, dtype=DOUBLE))


def test_layer_area_adds_squares_per_layer_and_ignores_moves():
    grown = torch.cat([SQUARE + 7.0, SQUARE * torch.tensor([2.0, 1.0], dtype=DOUBLE)])
    both, apart = torch.tensor([0, 0]), torch.tensor([0, 1])
    torch.testing.assert_close(layer_area(grown, SQUARE, HALVES, both), torch.tensor([0.0, 144.0], dtype=DOUBLE))
    torch.testing.assert_close(layer_area(grown, SQUARE, HALVES, apart), torch.tensor([0.0, 72.0], dtype=DOUBLE))


def test_folding_is_not_free():
    mirrored = SQUARE * torch.tensor([-1.0, 1.0], dtype=DOUBLE)
    assert layer_area(mirrored, SQUARE, HALVES, torch.tensor([0, 0])).item() == pytest.approx(24.0**2)


def test_gradients_match_finite_differences():
    target, rendered, background = (
        255 * random(2, 3, 4, 3),
        random(2, 3, 4, 4).requires_grad_(),
        255 * random(1, 3, 4, 3),
    )
    vertices = (10 * random(2, 4, 2)).requires_grad_()
    joint_vertices, joint_weights = torch.tensor([[[0, 1, 2], [1, 2, 3]]]), random(1, 2, 3)
    layers = torch.tensor([0, 1])
    assert torch.autograd.gradcheck(lambda r: masked_reconstruction(target, r), rendered)
    assert torch.autograd.gradcheck(lambda r: reconstruction(target, r, background), rendered)
    assert torch.autograd.gradcheck(lambda r: mask_area(r[..., 3], random(2, 3, 4)), rendered)
    assert torch.autograd.gradcheck(lambda v: joint_distance(v, joint_vertices, joint_weights), vertices)
    assert torch.autograd.gradcheck(lambda v: layer_area(v, SQUARE, HALVES, layers), vertices)
