import numpy as np

from wildpuppet.geometry.topology import (
    boundary_edges,
    components,
    signed_areas,
    smallest_angles,
    subdivide,
    unique_edges,
    vertex_adjacency,
)

VERTICES = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_square_of_two_triangles_by_hand():
    assert unique_edges(TRIANGLES).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
    assert sorted(map(tuple, boundary_edges(TRIANGLES))) == [(0, 1), (1, 2), (2, 3), (3, 0)]
    assert vertex_adjacency(TRIANGLES, 5).toarray().sum(axis=1).tolist() == [3, 2, 3, 2, 0]
    assert signed_areas(VERTICES, TRIANGLES).tolist() == [2.0, 2.0]
    np.testing.assert_allclose(smallest_angles(VERTICES, TRIANGLES), 45.0)


def test_components_count_loose_vertices():
    count, labels = components(np.array([[0, 1, 2], [4, 5, 6]]), 8)
    assert count == 4
    assert len(set(labels[[0, 1, 2]])) == 1
    assert len({labels[0], labels[3], labels[4], labels[7]}) == 4


def test_subdivision_keeps_area_winding_and_old_vertices():
    vertices, triangles, between = subdivide(VERTICES, TRIANGLES)
    np.testing.assert_array_equal(vertices[:4], VERTICES)
    np.testing.assert_allclose(vertices[4:], VERTICES[between].mean(axis=1))
    assert len(triangles) == 8
    np.testing.assert_allclose(signed_areas(vertices, triangles), 0.5)
    children = vertices[triangles.reshape(2, 4, 3)].mean(axis=2)
    np.testing.assert_allclose(children.mean(axis=1), VERTICES[TRIANGLES].mean(axis=1))
    assert len(boundary_edges(triangles)) == 8


def test_a_flat_triangle_has_no_angle():
    flat = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    assert smallest_angles(flat, np.array([[0, 1, 2], [0, 3, 3]])).tolist() == [0.0, 0.0]
