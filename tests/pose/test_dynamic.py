"""Dynamic programming against exhaustive search over all joint states of three parts."""

import numpy as np
import pytest

from tests.pose.boxes import Hinge, box_puppet
from wildpuppet.pose.dynamic import (
    Solution,
    Springs,
    child_modes,
    descend,
    pull_table,
    root_modes,
    solve,
    turn_costs,
)
from wildpuppet.pose.moves import spring_cost
from wildpuppet.pose.templates import PartImage, make_templates, palette_of, part_images
from wildpuppet.pose.tree import Tree, tree_of

ANGLES, HEIGHT, WIDTH = 4, 5, 6
RIM = 2.0
"""Cost of the outermost pivots: every joint of a pose worth taking then lies in the window."""
SCALE = 0.13
"""Arms are then at most one pixel long."""
TURN = 0.02
HINGE, LOOSE = pull_table(1.5, 0.05, WIDTH), pull_table(3.0, 0.05, WIDTH)
BOXES = [(8, 8, 9, 7), (16, 10, 11, 5), (24, 9, 7, 13)]
CHAIN: list[Hinge] = [(0, 1, (16.4, 11.7)), (1, 2, (25.5, 11.1))]
FAN: list[Hinge] = [(1, 0, (16.4, 11.7)), (1, 2, (25.5, 11.1))]
LOOSE_END: list[Hinge] = CHAIN[:1]


def solved(hinges: list[Hinge], seed: int) -> tuple[Solution, list[np.ndarray]]:
    puppet = box_puppet(BOXES, hinges)
    images = part_images(puppet)
    templates = make_templates(images, SCALE, ANGLES, palette_of(images, SCALE, 4))
    draw = np.random.default_rng(seed)
    inner = [draw.uniform(0, 1, (ANGLES, HEIGHT - 2, WIDTH - 2)).astype(np.float32) for _ in BOXES]
    unary = [np.pad(cost, ((0, 0), (1, 1), (1, 1)), constant_values=RIM) for cost in inner]
    return solve(unary, tree_of(puppet), images, templates, Springs(HINGE, LOOSE, HINGE, TURN, TURN)), unary


def joint_pixels(image: PartImage, at: tuple[float, float], scale: float) -> np.ndarray:
    """Joint's pixel for every state of a part, (K, H, W, 2): the arm turned x towards y and rounded."""
    pixels = np.zeros((ANGLES, HEIGHT, WIDTH, 2), int)
    for angle in range(ANGLES):
        cos, sin = np.cos(2 * np.pi * angle / ANGLES), np.sin(2 * np.pi * angle / ANGLES)
        arm = scale * np.array([[cos, -sin], [sin, cos]]) @ (np.array(at) - image.pivot)
        rows, columns = np.indices((HEIGHT, WIDTH))
        pixels[angle] = np.stack([columns, rows], -1) + np.rint(arm).astype(int)
    return pixels


def edge_costs(solution: Solution, tree: Tree) -> dict[tuple[int, int], np.ndarray]:
    """Cost of each edge for all pairs of states, (S, S): parent, child; infinite where a joint leaves the window."""
    costs, turns = {}, np.arange(ANGLES).repeat(HEIGHT * WIDTH)
    for edge in tree.edges:
        a, b = (
            joint_pixels(solution.images[layer], edge.at, solution.templates.scale).reshape(-1, 2)
            for layer in (edge.parent, edge.child)
        )
        inside = [((p >= 0) & (p < (WIDTH, HEIGHT))).all(-1) for p in (a, b)]
        gap = np.abs(a[:, None] - b[None]).clip(max=WIDTH)
        turn = np.abs(turns[:, None] - turns[None])
        radians = np.minimum(turn, ANGLES - turn) * 2 * np.pi / ANGLES
        bend = TURN * np.where(radians < 0.5, radians**2, radians - 0.25)
        costs[edge.parent, edge.child] = (HINGE if edge.is_hinge else LOOSE)[gap].sum(-1) + bend
        costs[edge.parent, edge.child][~(inside[0][:, None] & inside[1][None])] = np.inf
    return costs


def total_costs(solution: Solution, unary: list[np.ndarray]) -> np.ndarray:
    """Cost of all joint states, (S, S, S)."""
    own = [cost.ravel() for cost in unary]
    total = own[0][:, None, None] + own[1][None, :, None] + own[2][None, None]
    for (parent, child), cost in edge_costs(solution, solution.tree).items():
        ends = cost if parent < child else cost.T
        total = total + np.expand_dims(ends, 3 - parent - child)
    return total


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("hinges", [CHAIN, FAN, LOOSE_END], ids=["chain", "fan", "loose"])
def test_solution_is_the_best_of_all_joint_states(hinges, seed):
    solution, unary = solved(hinges, seed)
    total = total_costs(solution, unary)
    best = [np.unravel_index(state, (ANGLES, HEIGHT, WIDTH)) for state in np.unravel_index(total.argmin(), total.shape)]
    ((cost, root_state),) = root_modes(solution, 1, 1)
    assert cost == pytest.approx(total.min(), abs=1e-5)
    states = {solution.tree.root: root_state}
    descend(solution, states, solution.tree.root)
    for layer, (angle, y, x) in enumerate(best):
        assert states[layer] == (angle, x, y)
    evidence = sum(unary[layer][angle, y, x] for layer, (angle, y, x) in enumerate(best))
    whole = np.array([[states[layer] for layer in range(3)]])
    assert evidence + spring_cost(solution, whole)[0] == pytest.approx(total.min(), abs=1e-5)


def test_accumulated_costs_are_the_best_below_for_every_root_state():
    solution, unary = solved(CHAIN, 5)
    others = tuple(layer for layer in range(3) if layer != solution.tree.root)
    expected = total_costs(solution, unary).min(others).reshape(ANGLES, HEIGHT, WIDTH)
    found = solution.accumulated[solution.tree.root]
    np.testing.assert_allclose(found[:, 1:-1, 1:-1], expected[:, 1:-1, 1:-1], atol=1e-5)


def test_child_modes_are_the_best_of_each_angle():
    solution, _ = solved(CHAIN, 6)
    edge = solution.tree.edges[0]
    pairs = edge_costs(solution, solution.tree)[edge.parent, edge.child]
    angle, x, y = 3, 2, 1
    total = pairs.reshape(ANGLES, HEIGHT, WIDTH, -1)[angle, y, x] + solution.accumulated[edge.child].ravel()
    modes = child_modes(solution, edge.child, (angle, x, y), 4)
    assert modes[0][0] == pytest.approx(total.min(), abs=1e-5)
    assert [cost for cost, _ in modes] == sorted(cost for cost, _ in modes)
    for cost, (child_angle, child_x, child_y) in modes:
        of_state = total.reshape(ANGLES, HEIGHT, WIDTH)[child_angle]
        assert cost == pytest.approx(of_state.min(), abs=1e-5)
        assert of_state[child_y, child_x] == pytest.approx(cost, abs=1e-5)


def test_root_modes_are_apart_and_in_order():
    solution, _ = solved(CHAIN, 7)
    modes = root_modes(solution, 5, 1)
    costs = [cost for cost, _ in modes]
    assert costs == sorted(costs)
    assert costs[0] == solution.accumulated[solution.tree.root].min()
    for i, (_, first) in enumerate(modes):
        for _, second in modes[:i]:
            assert first[0] != second[0] or max(abs(first[1] - second[1]), abs(first[2] - second[2])) > 1


def test_costs_of_gaps_and_turns_are_hubers():
    np.testing.assert_allclose(pull_table(2.0, 0.1, 4), [0.0, 0.025, 0.1, 0.2, 0.3], atol=1e-7)
    turns = turn_costs(np.radians([0.0, 10.0, 90.0, 180.0, 270.0, 350.0]), 2.0)
    bent = [2 * np.radians(10) ** 2, 2 * (np.pi / 2 - 0.25), 2 * (np.pi - 0.25)]
    np.testing.assert_allclose(turns, [0.0, *bent, bent[1], bent[0]], rtol=1e-5)
