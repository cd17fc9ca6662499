"""Tree-structured dynamic programming over (angle, y, x) of every part (pictorial structures).

Felzenszwalb and Huttenlocher, "Pictorial Structures for Object Recognition" (IJCV 2005): messages run from the leaves
to the root, each the child's accumulated cost moved to the joint, spread by the joint's spring and by the cost of
turning. ``Solution`` keeps the accumulated maps, so that any part's alternatives, given its parent, can be read off.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.pose import kernels
from wildpuppet.pose.templates import UNCHANGED, PartImage, Templates
from wildpuppet.pose.tree import Edge, Tree

OUTSIDE = 4.0
"""Cost of a joint that leaves the search window."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Costs of bending the tree: of a gap of 0, 1, 2 ... search pixels along an axis, and of turns per radian^2.

    ``turn`` is that of a part against its parent, ``bend`` that of a piece against the other piece of its part, whose
    gaps (``tight``) are none but the grid's rounding.

    Gaps cost their square near 0 and grow linearly from there: joints drawn by hand or guessed from an overlap are
    rarely the true hinge, and a quadratic spring would rather lose a limb than open one.
    """

    hinge: Float[np.ndarray, "R"]
    loose: Float[np.ndarray, "R"]
    tight: Float[np.ndarray, "R"]
    turn: float
    bend: float

    def pull(self, edge: Edge) -> Float[np.ndarray, "R"]:
        """Choose the table of a bend, a hinge or a loose link."""
        return self.tight if edge.is_bend else self.hinge if edge.is_hinge else self.loose


LINEAR_TURN = 0.5
"""Radians beyond which a turn's cost is linear."""


def huber(ratio: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Square up to 1, linear beyond."""
    return np.where(ratio < 1, ratio**2, 2 * ratio - 1)


def pull_table(slack: float, cost: float, reach: int) -> Float[np.ndarray, "R"]:
    """Tabulate Huber's function: ``cost`` at a gap of ``slack`` pixels, linear beyond."""
    return (cost * huber(np.arange(reach + 1) / slack)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Link:
    """An edge at the templates' scale: offsets (x, y) from the parent's and the child's pivot to the joint.

    ``pull`` and ``turn`` are the costs of a gap of 0, 1, 2 ... pixels along an axis and of each of the K angles.
    """

    edge: Edge
    from_parent: Int[np.ndarray, "K 2"]
    from_child: Int[np.ndarray, "K 2"]
    pull: Float[np.ndarray, "R"]
    turn: Float[np.ndarray, "K"]

    def turn_of(self, angle: Int[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Cost of turns of the child against its parent, in steps of the templates' angles."""
        cost: Float[np.ndarray, "*shape"] = self.turn[angle % len(self.turn)]
        return cost

    def pull_of(self, gap: Int[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Cost of gaps (search pixels, not negative) along an axis; beyond the table it goes on linearly."""
        beyond = np.maximum(gap - len(self.pull) + 1, 0)
        cost: Float[np.ndarray, "*shape"] = self.pull[gap - beyond] + beyond * (self.pull[-1] - self.pull[-2])
        return cost


@dataclass(frozen=True, eq=False)
class Solution:
    """Cost of every part at every (angle, y, x): ``unary`` its own template's, ``accumulated`` with all below it."""

    tree: Tree
    templates: Templates
    springs: Springs
    images: tuple[PartImage, ...]
    unary: tuple[Float[np.ndarray, "K H W"], ...]
    accumulated: tuple[Float[np.ndarray, "K _ _"], ...]
    links: dict[int, Link]


State = tuple[int, int, int]
"""Angle index, x, y of a part's pivot pixel."""


def turn_costs(radians: Float[np.ndarray, "K"], weight: float) -> Float[np.ndarray, "K"]:
    """Cost of a child's turn relative to its parent: quadratic near rest, linear beyond half a radian."""
    turn = np.abs((radians + np.pi) % (2 * np.pi) - np.pi)
    return (weight * LINEAR_TURN**2 * huber(turn / LINEAR_TURN)).astype(np.float32)


def joint_offsets(
    image: PartImage, templates: Templates, at: tuple[float, float], shape: Float[np.ndarray, "2 2"] = UNCHANGED
) -> Int[np.ndarray, "K 2"]:
    """Offset (x, y) in pixels from a part's pivot to the joint, for every angle; ``shape`` as in ``make_templates``."""
    arm = shape @ (np.asarray(at) - image.pivot) * templates.scale
    cos, sin = np.cos(templates.radians), np.sin(templates.radians)
    turned = np.stack([cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]], -1)
    offsets: Int[np.ndarray, "K 2"] = np.rint(turned).astype(np.int64)
    return offsets


def solve(
    unary: list[Float[np.ndarray, "K H W"]],
    tree: Tree,
    images: tuple[PartImage, ...],
    templates: Templates,
    springs: Springs,
) -> Solution:
    """Pass messages from the leaves to the root."""
    accumulated = [cost.copy() for cost in unary]
    links = {
        edge.child: Link(
            edge,
            joint_offsets(images[edge.parent], templates, edge.at),
            joint_offsets(images[edge.child], templates, edge.at),
            springs.pull(edge),
            turn_costs(templates.radians, springs.bend if edge.is_bend else springs.turn),
        )
        for edge in tree.edges
    }
    for edge in reversed(tree.edges):
        send(accumulated, links[edge.child])
    return Solution(tree, templates, springs, images, tuple(unary), tuple(accumulated), links)


def send(accumulated: list[Float[np.ndarray, "K _ _"]], link: Link) -> None:
    """Add a child's accumulated cost to its parent's, through their joint's spring and the cost of turning."""
    message = kernels.shift_each(accumulated[link.edge.child], -link.from_child, OUTSIDE)
    message = kernels.turn_transform(kernels.spring_transform(message, link.pull), link.turn)
    accumulated[link.edge.parent] += kernels.shift_each(message, link.from_parent, OUTSIDE)


def root_modes(solution: Solution, num: int, apart: int) -> list[tuple[float, State]]:
    """List the root's best states, each at least ``apart`` pixels or a quarter turn from the better ones."""
    costs = solution.accumulated[solution.tree.root].copy()
    num_angles = len(costs)
    modes: list[tuple[float, State]] = []
    for _ in range(num):
        angle, y, x = (int(i) for i in np.unravel_index(np.argmin(costs), costs.shape))
        if not np.isfinite(costs[angle, y, x]):
            break
        modes.append((float(costs[angle, y, x]), (angle, x, y)))
        near = (np.arange(num_angles) - angle + num_angles // 2) % num_angles - num_angles // 2
        rows = slice(max(0, y - apart), y + apart + 1)
        columns = slice(max(0, x - apart), x + apart + 1)
        costs[np.abs(near) <= num_angles // 8, rows, columns] = np.inf
    return modes


def child_modes(solution: Solution, child: int, parent_state: State, num: int) -> list[tuple[float, State]]:
    """List a child's best states given its parent's, best first, no two at neighbouring angles."""
    link, costs = solution.links[child], solution.accumulated[child]
    num_angles, height, width = costs.shape
    pivots = np.array(parent_state[1:]) + link.from_parent[parent_state[0]] - link.from_child
    nearest, place = kernels.least_near(costs, pivots, link.pull, OUTSIDE)
    least = nearest + link.turn_of(np.arange(num_angles) - parent_state[0])
    modes: list[tuple[float, State]] = []
    for angle in np.argsort(least):
        near = [abs((int(angle) - other[0] + num_angles // 2) % num_angles - num_angles // 2) for _, other in modes]
        if min(near, default=num_angles) < max(2, num_angles // 15):
            continue
        x, y = (int(along) for along in np.clip(place[angle], 0, (width - 1, height - 1)))
        state = (int(angle), x, y)
        modes.append((float(least[angle]), state))
        if len(modes) == num:
            break
    return modes


def descend(solution: Solution, states: dict[int, State], layer: int) -> None:
    """Fill ``states`` with the best states of everything below ``layer``, whose own state is there already."""
    for edge in solution.tree.children(layer):
        states[edge.child] = child_modes(solution, edge.child, states[layer], 1)[0][1]
        descend(solution, states, edge.child)
