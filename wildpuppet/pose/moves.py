"""From one pose to better and to different ones: other modes of a limb, twins swapped, layers reordered.

Dynamic programming sees each part alone, so two legs like to stand on the same leg. Here whole poses are judged by
the composite (``evidence.unexplained_cost``: one explanation per pixel), and the candidates are what the dynamic
programme itself offers as second and third choices, plus explicit swaps of limbs that look alike.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.pose.dynamic import Solution, State, child_modes, descend, root_modes
from wildpuppet.pose.tree import Tree
from wildpuppet.pose.twins import Pair, limb_heads, main_pairs


@dataclass(frozen=True)
class Candidate:
    """A whole pose: a state per layer and a drawing order (back to front)."""

    states: tuple[State, ...]
    order: tuple[int, ...]


@runtime_checkable
class Frame(Protocol):
    """One frame: it judges whole poses and hangs limbs anew (``look.Look``)."""

    @property
    def solution(self) -> Solution:
        """What the dynamic programme found."""
        ...

    @property
    def twins(self) -> list[Pair]:
        """Limbs that can be taken for one another, the largest first."""
        ...

    @property
    def shaded(self) -> list[Pair]:
        """Those of them that differ in colour."""
        ...

    def judge(self, candidates: list[Candidate], /) -> Float[np.ndarray, "B"]:
        """Give the costs of whole poses, lower is better."""
        ...

    def rehang(
        self, candidate: Candidate, head: int, free: Sequence[int], num: int, reach: Mapping[int, int] = ..., /
    ) -> list[Candidate]:
        """Find the ``num`` best poses of the limb at ``head``, the parts ``free`` not there; ``reach``: near by."""
        ...

    def reseat(self, candidate: Candidate, /) -> Candidate:
        """Find the best place of the root near by, the other parts staying where they are."""
        ...

    def exchanged(self, candidate: Candidate, pairs: list[Pair], /) -> float:
        """Give the cost of a pose with the colours of pairs of twins exchanged, their price included."""
        ...


ROUNDS = 2
"""How often the limbs' next choices, swaps and orders are tried from the best poses."""


def best_candidates(frame: Frame, starts: list[Candidate], num_best: int, sweeps: int) -> list[tuple[float, Candidate]]:
    """Search from the root's best modes and from ``starts``; return distinct poses, best first."""
    solution, twins = frame.solution, frame.twins
    order = tuple(range(len(solution.images)))
    pool: dict[Candidate, float] = {}

    def consider(candidates: list[Candidate]) -> None:
        fresh = [c for c in dict.fromkeys(candidates) if c not in pool]
        if fresh:
            pool.update(zip(fresh, (float(cost) for cost in frame.judge(fresh)), strict=True))

    first = [Candidate(_completed(solution, state), order) for _, state in root_modes(solution, 3, 6)]
    consider(first + starts)
    expanded: set[Candidate] = set()
    for _ in range(ROUNDS):
        beam = [c for c in sorted(pool, key=pool.__getitem__)[:3] if c not in expanded]
        if not beam:
            break
        for candidate in beam:
            expanded.add(candidate)
            consider(list(_limb_moves(solution, candidate)) + list(_swaps(solution, candidate, twins)))
        top = min(pool, key=pool.__getitem__)
        consider(list(_reorders(solution.tree, top)))
    _rehang_limbs(frame, sweeps, pool, consider)
    top = min(pool, key=pool.__getitem__)
    cost, renamed = _renamed(frame, top, pool[top])
    pool[renamed] = min(cost, pool.get(renamed, cost))
    ranked = sorted(pool, key=pool.__getitem__)
    num_angles = len(solution.templates.radians)
    best = _distinct([(pool[c], c) for c in ranked], num_best, num_angles)
    traded = _traded(frame, best[0][1])
    consider(traded)
    new = [(pool[c], c) for c in traded if all(_differs(c, other, num_angles) for _, other in best)]
    return sorted(best + new, key=lambda entry: entry[0])


SISTERS = 8
"""Pairs of twins, the largest, that are hung anew together."""


def _rehang_limbs(
    frame: Frame, sweeps: int, pool: dict[Candidate, float], consider: Callable[[list[Candidate]], None]
) -> None:
    """Seat the root and hang every limb of the best pose anew, then both of every pair of sisters, while that helps."""
    tree = frame.solution.tree
    parents = {edge.child: edge.parent for edge in tree.edges}
    sisters = [pair for pair in frame.twins if parents[pair[0][0]] == parents[pair[1][0]]]
    for _ in range(sweeps):
        before = min(pool.values())
        consider([frame.reseat(min(pool, key=pool.__getitem__))])
        for head in limb_heads(tree):
            top = min(pool, key=pool.__getitem__)
            consider(frame.rehang(top, head, tree.below(head), 2))
        for pair in sisters[:SISTERS]:
            top = min(pool, key=pool.__getitem__)
            for first, second in (pair, pair[::-1]):
                for half in frame.rehang(top, first[0], [*first, *second], 1):
                    consider(frame.rehang(half, second[0], second, 1))
        if min(pool.values()) >= before - 1e-9:
            break


def _renamed(frame: Frame, top: Candidate, cost: float) -> tuple[float, Candidate]:
    """Trade the twins whose exchanged colours explain the frame better; the pose costs what it does in those."""
    traded: list[Pair] = []
    for pair in frame.shaded:
        if not any({*pair[0], *pair[1]} & {*first, *second} for first, second in traded):
            other = frame.exchanged(top, [*traded, pair])
            if other < cost:
                traded, cost = [*traded, pair], other
    for pair in traded:
        top = _settled(frame, top, pair)
    return cost, top


def _traded(frame: Frame, top: Candidate) -> list[Candidate]:
    """Trade each main pair of limbs, and the two largest at once; each limb then settles where the other left."""
    pairs = main_pairs(frame.solution.tree, frame.twins)
    settled = [_settled(frame, top, pair) for pair in pairs]
    return settled + [_settled(frame, settled[0], pair) for pair in pairs[1:2]]


def _settled(frame: Frame, candidate: Candidate, pair: Pair) -> Candidate:
    """Trade a pair and hang both limbs anew, each nearer to its twin's old place than to its own."""
    reach = {}
    for a, b in zip(*pair, strict=True):
        apart = int(np.abs(np.array(candidate.states[a][1:]) - np.array(candidate.states[b][1:])).max())
        reach[a] = reach[b] = min(_trade_reach(frame.solution), max(1, (apart - 1) // 2))
    traded = _swapped(frame.solution, candidate, pair, reach)
    for limb in pair:
        traded = frame.rehang(traded, limb[0], limb, 1, reach)[0]
    return traded


def spring_cost(solution: Solution, states: Int[np.ndarray, "B L 3"]) -> Float[np.ndarray, "B"]:
    """Sum the springs' and turns' costs of whole poses."""
    total = np.zeros(len(states))
    for link in solution.links.values():
        parent, child = states[:, link.edge.parent], states[:, link.edge.child]
        a = parent[:, 1:] + link.from_parent[parent[:, 0]]
        b = child[:, 1:] + link.from_child[child[:, 0]]
        total += link.pull_of(np.abs(a - b)).sum(1)
        total += link.turn_of(child[:, 0] - parent[:, 0])
    return total


def _completed(solution: Solution, root_state: State) -> tuple[State, ...]:
    states = {solution.tree.root: root_state}
    descend(solution, states, solution.tree.root)
    return tuple(states[layer] for layer in range(len(solution.images)))


def _limb_moves(solution: Solution, candidate: Candidate) -> Iterator[Candidate]:
    """Re-hang every subtree on its next best modes, everything below it following."""
    for edge in solution.tree.edges:
        for _, state in child_modes(solution, edge.child, candidate.states[edge.parent], 4):
            states = dict(enumerate(candidate.states))
            states[edge.child] = state
            descend(solution, states, edge.child)
            yield Candidate(tuple(states[layer] for layer in range(len(states))), candidate.order)


def _swaps(solution: Solution, candidate: Candidate, twins: list[Pair]) -> Iterator[Candidate]:
    """Let two limbs that look alike trade places: each part goes near where its twin was, as its picture fits best."""
    for pair in twins:
        reach = dict.fromkeys((*pair[0], *pair[1]), _trade_reach(solution))
        yield _swapped(solution, candidate, pair, reach)


def _swapped(solution: Solution, candidate: Candidate, pair: Pair, reach: Mapping[int, int]) -> Candidate:
    states = dict(enumerate(candidate.states))
    for mine, other in (pair, pair[::-1]):
        for layer, model in zip(mine, other, strict=True):
            states[layer] = _in_place_of(solution, layer, states, candidate.states[model], reach[layer])
    return Candidate(tuple(states[layer] for layer in range(len(states))), candidate.order)


TRADE_REACH = 0.08
"""How far from its twin's place a part may lie, as a share of the search window's larger side."""


def _trade_reach(solution: Solution) -> int:
    """Give that reach in search pixels."""
    height, width = (int(side) for side in solution.unary[0].shape[1:])
    return max(2, round(TRADE_REACH * max(height, width)))


def _in_place_of(solution: Solution, layer: int, states: dict[int, State], model: State, reach: int) -> State:
    """Find the best state of ``layer`` near ``model``'s place: its picture and the hinge to its parent's new place."""
    link, costs = solution.links[layer], solution.unary[layer]
    num_angles, height, width = costs.shape
    rows = np.arange(max(0, model[2] - reach), min(height, model[2] + reach + 1))
    columns = np.arange(max(0, model[1] - reach), min(width, model[1] + reach + 1))
    parent = states[link.edge.parent]
    joint = np.array(parent[1:]) + link.from_parent[parent[0]] - link.from_child
    pull_x = link.pull_of(np.abs(columns - joint[:, 0, None]))
    pull_y = link.pull_of(np.abs(rows - joint[:, 1, None]))
    turn = link.turn_of(np.arange(num_angles) - parent[0])
    window = costs[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    total = window + pull_y[:, :, None] + pull_x[:, None] + turn[:, None, None]
    angle, row, column = np.unravel_index(np.argmin(total), total.shape)
    return int(angle), int(columns[column]), int(rows[row])


def _reorders(tree: Tree, candidate: Candidate) -> Iterator[Candidate]:
    """Lift each subtree to the front or push it to the back, keeping its inner order; a part stays in one piece."""
    for edge in (edge for edge in tree.edges if not edge.is_bend):
        moving = set(tree.below(edge.child))
        rest = tuple(layer for layer in candidate.order if layer not in moving)
        limb = tuple(layer for layer in candidate.order if layer in moving)
        for order in (rest + limb, limb + rest):
            if order != candidate.order:
                yield Candidate(candidate.states, order)


def _distinct(ranked: list[tuple[float, Candidate]], num_best: int, num_angles: int) -> list[tuple[float, Candidate]]:
    """Drop poses that differ from a better one only by small steps or by an order of layers."""
    kept: list[tuple[float, Candidate]] = []
    for cost, candidate in ranked:
        if all(_differs(candidate, other, num_angles) for _, other in kept):
            kept.append((cost, candidate))
            if len(kept) == num_best:
                break
    return kept


def _differs(a: Candidate, b: Candidate, num_angles: int) -> bool:
    first, second = np.array(a.states), np.array(b.states)
    turn = (first[:, 0] - second[:, 0] + num_angles // 2) % num_angles - num_angles // 2
    return bool((np.abs(turn) > num_angles // 12).any() or (np.abs(first[:, 1:] - second[:, 1:]) > 4).any())
