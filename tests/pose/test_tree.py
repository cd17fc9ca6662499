import numpy as np
import pytest

from tests.pose.boxes import box_puppet
from wildpuppet.pose.tree import Tree, joint_points, part_areas, tree_of

ROW = [(4 + 10 * i, 20, 10, 6) for i in range(5)]
ELBOWS = [(i, i + 1, (14.0 + 10 * i, 23.0)) for i in range(4)]


def check_spans(tree: Tree, num_layers: int) -> None:
    """Every layer is reached once, after its parent."""
    reached = [tree.root]
    for edge in tree.edges:
        assert edge.parent in reached
        reached.append(edge.child)
    assert sorted(reached) == list(range(num_layers))


def pairs(tree: Tree, is_hinge: bool) -> set[frozenset[int]]:
    return {frozenset((edge.parent, edge.child)) for edge in tree.edges if edge.is_hinge == is_hinge}


def test_chain_hangs_from_its_middle():
    tree = tree_of(box_puppet(ROW, ELBOWS))
    check_spans(tree, 5)
    assert tree.root == 2
    assert pairs(tree, True) == {frozenset(pair) for pair in ((0, 1), (1, 2), (2, 3), (3, 4))}
    places = {frozenset((edge.parent, edge.child)): edge.at for edge in tree.edges}
    for a, b, at in ELBOWS:
        assert places[frozenset((a, b))] == pytest.approx(at)
    assert {edge.child for edge in tree.children(2)} == {1, 3}
    assert sorted(tree.below(3)) == [3, 4]
    assert sorted(tree.below(2)) == [0, 1, 2, 3, 4]


def test_forest_is_tied_where_its_trees_come_nearest():
    boxes = [*ROW[:2], (44, 20, 10, 6), (54, 20, 10, 6)]
    tree = tree_of(box_puppet(boxes, [ELBOWS[0], (2, 3, (54.0, 23.0))], canvas=(80, 48)))
    check_spans(tree, 4)
    assert pairs(tree, True) == {frozenset((0, 1)), frozenset((2, 3))}
    assert pairs(tree, False) == {frozenset((1, 2))}
    (loose,) = [edge for edge in tree.edges if not edge.is_hinge]
    assert 24 <= loose.at[0] <= 44  # between the two


def test_cycle_gives_up_one_hinge():
    boxes = [(4, 4, 20, 20), (24, 4, 20, 20), (14, 24, 20, 20)]
    ring = [(0, 1, (24.0, 14.0)), (1, 2, (28.0, 24.0)), (2, 0, (20.0, 24.0))]
    tree = tree_of(box_puppet(boxes, ring))
    check_spans(tree, 3)
    assert len(pairs(tree, True)) == 2
    assert not pairs(tree, False)


def test_two_hinges_between_two_parts_are_one_edge():
    tree = tree_of(box_puppet(ROW[:2], [(0, 1, (14.0, 21.0)), (1, 0, (14.0, 25.0))]))
    check_spans(tree, 2)
    assert len(tree.edges) == 1


@pytest.mark.parametrize("num", [1, 5])
def test_parts_without_hinges_are_all_tied(num):
    islands = [(4 + 30 * i, 20, 10, 6) for i in range(num)]
    tree = tree_of(box_puppet(islands, canvas=(160, 48)))
    check_spans(tree, num)
    assert pairs(tree, False) == {frozenset((i, i + 1)) for i in range(num - 1)}


def test_areas_and_joint_places():
    puppet = box_puppet(ROW[:2], ELBOWS[:1])
    np.testing.assert_allclose(part_areas(puppet), 16.0 * 12.0)  # the mesh, its margins included
    np.testing.assert_allclose(joint_points(puppet), [[[14.0, 23.0], [14.0, 23.0]]])
