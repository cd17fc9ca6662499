"""The renderer against hand-made pictures, both backends against each other, gradients against finite differences."""

from typing import get_args

import pytest
import torch

from tests.render.scenes import flat_texture, grid_cells, grid_puppet, soft_texture, square
from wildpuppet.render.render import Backend, Mesh, Texture, render

BACKENDS = [backend for backend in get_args(Backend) if backend != "auto"]
EIGHT_BIT = 0.5 / 255.0
ORDER = torch.tensor([[0]])
TRUNCATION = 4e-3
"""The CPU path stops behind 1023/1024 of coverage; gradients of what lies there are lost, at most this share."""


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Backend:
    chosen: Backend = request.param
    return chosen


def test_square_by_hand(backend: Backend) -> None:
    vertices, mesh = square()
    texture = flat_texture(vertices, (0.25, 0.5, 0.0, 0.5))
    rgba = render(vertices, mesh, texture, ORDER, (9, 8), backend=backend).rgba
    expected = torch.zeros(1, 8, 9, 4)
    expected[0, 3:7, 2:6] = torch.tensor([0.25, 0.5, 0.0, 0.5])
    torch.testing.assert_close(rgba, expected)


def test_texture_is_sampled_bilinearly_with_a_corner_origin(backend: Backend) -> None:
    vertices, mesh = square()
    ramp = torch.arange(8.0) + 0.5
    rgba = torch.stack([ramp.expand(8, 8), ramp[:, None].expand(8, 8), torch.zeros(8, 8), torch.full((8, 8), 0.5)], -1)
    texture = Texture(rgba.contiguous(), vertices[0] - 0.75)
    drawn = render(vertices, mesh, texture, ORDER, (9, 8), backend=backend).rgba[0, 3:7, 2:6]
    torch.testing.assert_close(drawn[..., 0], (torch.arange(2.0, 6.0) + 0.5 - 0.75).expand(4, 4))
    torch.testing.assert_close(drawn[..., 1], (torch.arange(3.0, 7.0) + 0.5 - 0.75)[:, None].expand(4, 4))


def test_pixel_centres_on_edges_follow_the_top_left_rule(backend: Backend) -> None:
    vertices, mesh = square()
    alpha = render(vertices + 0.5, mesh, flat_texture(vertices, (0, 0, 0, 0.5)), ORDER, (9, 9), backend=backend).rgba[
        0, ..., 3
    ]
    expected = torch.zeros(9, 9)
    expected[3:7, 2:6] = 0.5
    assert torch.equal(alpha, expected)


def test_shared_edges_are_covered_exactly_once(backend: Backend) -> None:
    """A jittered grid with slivers, and the same on whole pixels, tile the image: half alpha must give a half."""
    generator = torch.Generator().manual_seed(3)
    steps = torch.cat([torch.linspace(-2, 42, 23), torch.tensor([20.0, 20.0, 20.000002])]).sort().values
    side = len(steps)
    grid = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1)
    room = steps.diff()[1:].clamp(max=0.9)
    jitter = torch.rand(side - 2, side - 2, 2, generator=generator)
    grid[1:-1, 1:-1] += jitter * torch.stack(torch.meshgrid(room, room, indexing="xy"), -1)
    vertices = torch.cat([grid.reshape(1, -1, 2), grid.round().reshape(1, -1, 2)])
    triangles = grid_cells(side)
    mesh = Mesh(triangles, torch.zeros(len(triangles), dtype=torch.int64), 1)
    texture = flat_texture(vertices, (0.5, 0.5, 0.5, 0.5))
    rgba = render(vertices, mesh, texture, ORDER.expand(2, 1), (40, 40), backend=backend).rgba
    torch.testing.assert_close(rgba, torch.full_like(rgba, 0.5), atol=1e-6, rtol=0)


def test_layers_are_composited_in_each_frames_own_order(backend: Backend) -> None:
    corners, one = square()
    triangles = torch.cat([one.triangles, one.triangles + 4])
    mesh = Mesh(triangles, torch.tensor([0, 0, 1, 1]), 2)
    vertices = torch.cat([corners, corners], 1).expand(2, -1, -1)
    rgba = torch.zeros(4, 12, 4)
    rgba[:, :6] = torch.tensor([0.8, 0.0, 0.0, 0.8])
    rgba[:, 6:] = torch.tensor([0.0, 0.4, 0.0, 0.4])
    texture = Texture(rgba, torch.tensor([[2.0, 2.0]] * 4 + [[9.0, 2.0]] * 4))
    opacity = torch.tensor([[0.5, 1.0], [0.5, 1.0]])
    drawn = render(vertices, mesh, texture, torch.tensor([[0, 1], [1, 0]]), (8, 8), opacity, backend).rgba[:, 5, 4]
    expected = torch.tensor([[0.4 * 0.6, 0.4, 0.0, 0.64], [0.4, 0.4 * 0.6, 0.0, 0.64]])
    torch.testing.assert_close(drawn, expected)


def test_folded_layer_covers_a_pixel_once_and_mirrored_one_is_drawn(backend: Backend) -> None:
    vertices, mesh = square()
    texture = flat_texture(vertices, (0, 0, 0, 0.5))
    folded = vertices.clone()
    folded[0, 3] = torch.tensor([6.0, 3.5])
    alpha = render(folded, mesh, texture, ORDER, (9, 9), backend=backend).rgba[..., 3]
    assert set(alpha.unique().tolist()) == {0.0, 0.5}
    mirrored = vertices * torch.tensor([-1.0, 1.0]) + torch.tensor([8.0, 0.0])
    drawn = [render(v, mesh, texture, ORDER, (9, 9), backend=backend).rgba for v in (vertices, mirrored)]
    torch.testing.assert_close(drawn[0], drawn[1])


def test_degenerate_and_far_triangles_are_harmless(backend: Backend) -> None:
    vertices, mesh = square()
    texture = flat_texture(vertices, (0.5, 0.5, 0.5, 0.5))
    to_a_line = vertices * torch.tensor([1.0, 0.0]) + torch.tensor([0.0, 4.5])
    to_a_point = vertices * 0.0 + 4.5
    far = vertices * 1e9 + 1e9
    huge = (vertices - 4.0) * 1e6
    moving = torch.cat([to_a_line, to_a_point, far, huge]).requires_grad_()
    rgba = render(moving, mesh, texture, ORDER.expand(4, 1), (9, 9), backend=backend).rgba
    rgba.sum().backward()
    assert rgba.detach()[:3].abs().max() == 0
    torch.testing.assert_close(rgba.detach()[3], torch.full((9, 9, 4), 0.5))
    assert moving.grad is not None
    assert torch.isfinite(moving.grad).all()


def test_part_off_the_image_is_clipped(backend: Backend) -> None:
    vertices, mesh, texture, order = grid_puppet(3, 2, 32, seed=5)
    whole = render(vertices + 16, mesh, texture, order, (64, 64), backend=backend).rgba
    clipped = render(vertices, mesh, texture, order, (32, 20), backend=backend).rgba
    torch.testing.assert_close(clipped, whole[:, 16:36, 16:48], atol=2e-4, rtol=0)


def test_empty_batch_and_wrong_arguments(backend: Backend) -> None:
    vertices, mesh = square()
    texture = flat_texture(vertices, (0, 0, 0, 1))
    assert render(vertices[:0], mesh, texture, ORDER[:0], (9, 8), backend=backend).rgba.shape == (0, 8, 9, 4)
    with pytest.raises(ValueError, match="finite"):
        render(vertices * float("nan"), mesh, texture, ORDER, (9, 8), backend=backend)
    with pytest.raises(ValueError, match="permutation"):
        render(vertices, mesh, texture, ORDER + 1, (9, 8), backend=backend)
    with pytest.raises((ValueError, TypeError), match="opacity"):
        render(vertices, mesh, texture, ORDER, (9, 8), torch.ones(1, 2), backend)
    with pytest.raises(ValueError, match="triangles"):
        render(vertices, mesh._replace(triangles=mesh.triangles + 1), texture, ORDER, (9, 8), backend=backend)
    with pytest.raises(ValueError, match="vertices"):
        render(vertices[:, :3], mesh, texture, ORDER, (9, 8), backend=backend)


@pytest.mark.parametrize("seed", range(3))
def test_backends_agree(seed: int) -> None:
    """8-bit parity everywhere: both follow the same rule with the same rounding, so no pixel differs at edges."""
    vertices, mesh, texture, order = grid_puppet(6, 3, 64, seed)
    opacity = 0.3 + 0.6 * torch.rand(order.shape, generator=torch.Generator().manual_seed(seed))
    opaque = flat_texture(vertices, (1, 1, 1, 1))

    def both(texture: Texture, opacity: torch.Tensor | None) -> list[torch.Tensor]:
        return [render(vertices, mesh, texture, order, (64, 60), opacity, backend).rgba for backend in BACKENDS]

    soft, hard = both(texture, opacity), both(opaque, None)
    assert (soft[0] - soft[1]).abs().max() < EIGHT_BIT
    assert torch.equal(hard[0][..., 3] > 0, hard[1][..., 3] > 0)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_of_backends_agree(seed: int) -> None:
    vertices, mesh, texture, order = grid_puppet(6, 3, 64, seed)
    generator = torch.Generator().manual_seed(seed)
    opacity = 0.3 + 0.6 * torch.rand(order.shape, generator=generator)
    upstream = torch.randn(3, 64, 64, 4, generator=generator)
    gradients = []
    for backend in BACKENDS:
        leaves = [tensor.clone().requires_grad_() for tensor in (vertices, texture.rgba, opacity)]
        rgba = render(leaves[0], mesh, Texture(leaves[1], texture.uv), order, (64, 64), leaves[2], backend).rgba
        gradients.append(torch.autograd.grad((rgba * upstream).sum(), leaves))
    for fast, slow in zip(*gradients, strict=True):
        assert (fast - slow).norm() < TRUNCATION * slow.norm()


def test_gradient_against_finite_differences() -> None:
    """The image is continuous across silhouettes, so differences of the whole image must agree, edges included."""
    vertices, mesh, texture, order = grid_puppet(3, 1, 24, seed=7, bend=0.3)
    vertices, rgba, uv = vertices.double(), texture.rgba.double(), texture.uv.double()
    opacity = torch.tensor([[0.9, 0.5, 0.7]], dtype=torch.float64)
    weights = torch.randn(1, 24, 24, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)

    def loss(vertices: torch.Tensor, rgba: torch.Tensor, opacity: torch.Tensor) -> torch.Tensor:
        return (render(vertices, mesh, Texture(rgba, uv), order, (24, 24), opacity).rgba * weights).sum()

    leaves = [tensor.clone().requires_grad_() for tensor in (vertices, rgba, opacity)]
    analytic = torch.autograd.grad(loss(*leaves), leaves)
    generator = torch.Generator().manual_seed(2)
    for which, step in ((0, 1e-7), (1, 1e-5), (2, 1e-5)):
        for _ in range(5):
            direction = torch.randn(leaves[which].shape, generator=generator, dtype=torch.float64)
            values = []
            for side in (1.0, -1.0):
                moved = [leaf.detach() for leaf in leaves]
                moved[which] = moved[which] + side * step * direction
                values.append(loss(*moved))
            numeric = (values[0] - values[1]) / (2 * step)
            torch.testing.assert_close((analytic[which] * direction).sum(), numeric, rtol=1e-5, atol=1e-6)


def test_moving_a_part_changes_its_mask_by_what_crosses_the_edge() -> None:
    """Closed form: the mask's area does not change with a shift, and grows as the square of a zoom."""
    vertices, mesh = square()
    vertices = ((vertices - 4.3) * 5 + 20.2).requires_grad_()
    rest = vertices.detach()[0] - vertices.detach()[0].min(0).values
    texture = soft_texture(20, rest, torch.Generator().manual_seed(0))
    area = render(vertices, mesh, texture, ORDER, (40, 40)).rgba[..., 3].sum()
    (gradient,) = torch.autograd.grad(area, vertices)
    area = area.detach()
    torch.testing.assert_close(gradient.sum(1), torch.zeros(1, 2), atol=0.02 * float(area) ** 0.5, rtol=0)
    centred = vertices.detach() - vertices.detach().mean(1, keepdim=True)
    torch.testing.assert_close((gradient * centred).sum(), 2 * area, rtol=0.02, atol=0)


def test_fast_path_refuses_what_it_cannot_draw() -> None:
    vertices, mesh = square()
    texture = flat_texture(vertices, (0, 0, 0, 1))
    with pytest.raises(ValueError, match="float32"):
        render(vertices.double(), mesh, texture, ORDER, (9, 8), backend="cpu")
    drawn = render(vertices.double(), mesh, texture, ORDER, (9, 8)).rgba
    assert drawn.dtype == torch.float64
