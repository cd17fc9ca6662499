"""Limbs that can be taken for one another: a left and a right one."""

import numpy as np
from jaxtyping import Float

from wildpuppet.pose.tree import Tree

Pair = tuple[tuple[int, ...], tuple[int, ...]]
"""The parts of two limbs, one by one."""
ALIKE = 25.0
"""Largest distance in Lab between the mean colours of parts that can be taken for one another."""


def twin_limbs(tree: Tree, areas: Float[np.ndarray, "L"], colours: Float[np.ndarray, "L 3"]) -> list[Pair]:
    """Pair limbs of as many parts, of about the same sizes and colours (Lab) one by one: a left and a right one.

    The largest pairs come first.
    """
    heads = [edge.child for edge in tree.edges]
    pairs = []
    for i, first in enumerate(heads):
        for second in heads[i + 1 :]:
            a, b = tree.below(first), tree.below(second)
            if len(a) != len(b) or first in b or second in a:
                continue
            ratio = areas[list(a)] / np.maximum(areas[list(b)], 1e-6)
            apart = np.linalg.norm(colours[list(a)] - colours[list(b)], axis=1)
            if ((ratio > 0.5) & (ratio < 2.0)).all() and (apart < ALIKE).all():
                pairs.append((a, b))
    return sorted(pairs, key=lambda pair: -float(areas[list(pair[0] + pair[1])].sum()))


PAIRS = 3
"""Pairs of twins whose trade is always offered to the choice over time."""
MOST_TRADES = PAIRS + 1
"""Poses that these trades add to a frame's hypotheses."""


def main_pairs(tree: Tree, twins: list[Pair]) -> list[Pair]:
    """Choose whole limbs of one parent that can be taken for one another; ``twins`` come largest first."""
    parents = {edge.child: edge.parent for edge in tree.edges}
    heads = limb_heads(tree)
    chosen: list[Pair] = []
    taken: set[int] = set()
    for first, second in twins:
        is_limb = first[0] in heads and second[0] in heads and parents[first[0]] == parents[second[0]]
        if is_limb and not taken & {*first, *second} and len(chosen) < PAIRS:
            chosen.append((first, second))
            taken |= {*first, *second}
    return chosen


def limb_heads(tree: Tree) -> list[int]:
    """List where limbs begin: a part of a chain goes with the chain's first, unless that hangs from a fork."""
    forks = {edge.parent for edge in tree.edges if len(tree.children(edge.parent)) > 1} | {tree.root}
    return [edge.child for edge in tree.edges if edge.parent in forks]
