import numpy as np
import pytest

from wildpuppet.geometry.topology import boundary_edges, components, signed_areas, smallest_angles, unique_edges
from wildpuppet.geometry.triangulate import triangulate

SQUARE = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]])
HOLE = np.array([[40.0, 20.0], [60.0, 20.0], [60.0, 40.0], [40.0, 40.0]])
LONGEST_SHARE = 2.0
"""The bound that the module's docstring derives from the angle and the area."""


def star(corners: int, inner: float, outer: float) -> np.ndarray:
    angles = np.arange(2 * corners) * np.pi / corners
    radius = np.where(np.arange(2 * corners) % 2, inner, outer)
    return 120.0 + np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)


def lengths(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    edges = unique_edges(triangles)
    return np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)


@pytest.mark.parametrize("edge", [8.0, 25.0])
@pytest.mark.parametrize("rings", [[SQUARE], [SQUARE, HOLE], [SQUARE[::-1], HOLE], [star(5, 60.0, 110.0)]])
def test_angles_and_edges_are_bounded_and_the_area_is_exact(rings, edge):
    vertices, triangles = triangulate(rings, edge=edge, least_angle=25.0)
    areas = signed_areas(vertices, triangles)
    expected = abs(shoelace(rings[0])) - sum(abs(shoelace(ring)) for ring in rings[1:])
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(expected, rel=1e-9)
    assert areas.max() <= np.sqrt(3.0) / 4.0 * edge**2 * (1.0 + 1e-9)
    assert smallest_angles(vertices, triangles).min() >= 25.0 - 1e-6
    assert lengths(vertices, triangles).max() <= LONGEST_SHARE * edge


def shoelace(ring: np.ndarray) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def test_a_hole_stays_open_and_pieces_stay_apart():
    vertices, triangles = triangulate([SQUARE, HOLE, SQUARE + np.array([200.0, 0.0])], edge=12.0)
    euler = len(vertices) - len(unique_edges(triangles)) + len(triangles)
    assert euler == 0 + 1  # a ring and a disc
    assert components(triangles, len(vertices))[0] == 2
    middles = vertices[triangles].mean(axis=1)
    assert not ((middles > 40.0) & (middles < [60.0, 40.0]) & (middles[:, 1:] > 20.0)).all(axis=1).any()


def test_every_boundary_edge_lies_on_a_ring():
    vertices, triangles = triangulate([SQUARE, HOLE], edge=12.0)
    middles = vertices[boundary_edges(triangles)].mean(axis=1)
    on_square = np.isclose(middles[:, 0] % 100.0, 0.0) | np.isclose(middles[:, 1] % 60.0, 0.0)
    on_hole = np.isclose(np.abs(middles - 50.0)[:, 0], 10.0) | np.isclose(np.abs(middles[:, 1] - 30.0), 10.0)
    assert (on_square | on_hole).all()


def test_the_same_rings_give_the_same_mesh():
    first, second = (triangulate([star(7, 50.0, 100.0)], edge=9.0) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


def test_repeated_points_and_a_closing_point_do_no_harm():
    doubled = np.repeat(np.concatenate([SQUARE, SQUARE[:1]]), 2, axis=0)
    vertices, triangles = triangulate([doubled], edge=20.0)
    assert signed_areas(vertices, triangles).sum() == pytest.approx(6000.0)


@pytest.mark.parametrize("ring", [SQUARE[:2], SQUARE * [1.0, 0.0], np.full((4, 2), np.nan)])
def test_rings_without_area_are_refused(ring):
    with pytest.raises(ValueError, match="triangulate"):
        triangulate([ring], edge=10.0)
