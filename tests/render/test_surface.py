"""What is seen at each pixel, by hand and between backends."""

import pytest
import torch

from tests.render.scenes import flat_texture, grid_puppet, square
from wildpuppet.render.render import Mesh
from wildpuppet.render.surface import surface


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_visible_layer_is_where_coverage_passes_the_threshold(backend: str) -> None:
    corners, one = square()
    mesh = Mesh(torch.cat([one.triangles, one.triangles + 4]), torch.tensor([1, 1, 0, 0]), 2)
    vertices = torch.cat([corners, corners + 2.0], 1).expand(2, -1, -1)
    texture = flat_texture(vertices, (0, 0, 0, 0.4))
    opacity = torch.tensor([[1.0, 2.0]]).expand(2, 2)
    order = torch.tensor([[1, 0], [0, 1]])
    seen = surface(vertices, mesh, texture, order, (10, 10), opacity, backend=backend)  # type: ignore[arg-type]
    both, first_only, second_only, nothing = (6, 5), (4, 3), (8, 7), (1, 1)
    for frame in range(2):
        assert seen.layer[frame][both] == 1
        assert seen.layer[frame][first_only] == 1
        assert seen.layer[frame][second_only] == -1, "0.4 is under the threshold"
        assert seen.triangle[frame][nothing] == -1
    weights, triangle = seen.barycentrics[0][both], int(seen.triangle[0][both])
    assert triangle in (0, 1)
    torch.testing.assert_close(weights @ vertices[0, mesh.triangles[triangle]], torch.tensor([5.5, 6.5]))
    faint = surface(vertices, mesh, texture, order, (10, 10), opacity, 0.3, backend)  # type: ignore[arg-type]
    assert [int(faint.layer[frame][both]) for frame in range(2)] == [0, 1]


def test_backends_see_the_same() -> None:
    vertices, mesh, texture, order = grid_puppet(6, 3, 64, seed=4)
    fast, slow = (surface(vertices, mesh, texture, order, (64, 60), backend=b) for b in ("cpu", "reference"))  # type: ignore[arg-type]
    assert (fast.layer != slow.layer).sum() == 0
    assert (fast.triangle != slow.triangle).sum() == 0
    torch.testing.assert_close(fast.barycentrics, slow.barycentrics, atol=1e-4, rtol=0)
    assert (fast.layer >= 0).float().mean() > 0.2
