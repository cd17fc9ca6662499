"""Parts that are drawn longer or shorter: by hand, no two drawings of a shin have the same length.

A rigid part of another length pulls what hangs from it off its place, or lets it lie down along it. After the search,
every part of the best pose is tried a step longer and shorter along its own axis, its limb hung anew each time, and
what explains the drawing better, at a price, stays.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from wildpuppet.pose.dynamic import Link, Solution, joint_offsets
from wildpuppet.pose.look import Look, Searcher
from wildpuppet.pose.moves import Candidate
from wildpuppet.pose.templates import UNCHANGED, Templates
from wildpuppet.pose.twins import limb_heads

STEP = 1.2
"""Ratio between neighbouring lengths."""
MOST = 2
"""Steps from the drawn length that are tried at most."""
SWEEPS = 2
"""How often all parts are tried, while that helps."""


@dataclass(frozen=True)
class Tries:
    """How lengths are tried: by ``changes`` (steps), the ``num`` most promising at a time, None: all of them.

    A part turns by at most ``turn`` of a full turn while its own length changes. ``is_deep``: what hangs from it is
    hung anew once more by itself, as a foot that lies along its shin counts the shin's pixels as its own before.
    """

    num: int | None
    changes: tuple[int, ...]
    turn: float
    is_deep: bool


IN_CLIP, IN_DRAWING = Tries(6, (-1, 1), 1.0, is_deep=False), Tries(None, (-1, 1, -2, 2), 0.125, is_deep=True)
"""A clip's drawings follow one another: few parts differ much. Another drawing's turns were all weighed before."""

Stretches = Mapping[int, int]
"""By how many steps parts are longer than drawn."""


def stretched(
    look: Look, cost: float, candidate: Candidate, price: float, tries: Tries
) -> tuple[float, Candidate, Look]:
    """Stretch and shorten the parts of a pose, one at a time, while that pays; give its cost and the look it is in.

    ``price`` is what the first step of a part costs, in units of an average part's evidence; it grows with the square.
    """
    tree = look.solution.tree
    heads = {layer: head for head in limb_heads(tree) for layer in tree.below(head)}
    best, steps = (cost, candidate, look), dict.fromkeys(heads, 0)
    most = round(tries.turn * len(look.templates.radians))
    for _ in range(SWEEPS):
        before = best[0]
        for layer, change in _changes(look, best[1], steps, price, tries):
            tried = {**steps, layer: steps[layer] + change}
            if abs(tried[layer]) > MOST:
                continue
            longer = look_with(look, tried)
            limb = tree.below(heads[layer])
            found = longer.rehang(best[1], heads[layer], limb, 2, turns={layer: most})
            if tries.is_deep:
                found = _with_hung_below(longer, found, layer)
            costs = longer.judge(found) + price * _squares(tried)
            row = int(np.argmin(costs))
            if costs[row] < best[0] - 1e-9:
                best, steps = (float(costs[row]), found[row], longer), tried
        if best[0] >= before - 1e-9:
            break
    return best


def _with_hung_below(look: Look, poses: list[Candidate], layer: int) -> list[Candidate]:
    """Add the poses in which some of what hangs from a part is hung anew by itself."""
    tree = look.solution.tree
    for edge in tree.children(layer):
        poses = poses + [one for pose in poses for one in look.rehang(pose, edge.child, tree.below(edge.child), 1)]
    return poses


def _squares(steps: Stretches) -> int:
    return sum(step**2 for step in steps.values())


def _changes(look: Look, candidate: Candidate, steps: Stretches, price: float, tries: Tries) -> list[tuple[int, int]]:
    """List the changes of length to try: all, or those that cost least when all below the part goes along."""
    changes = [(layer, change) for layer in steps for change in tries.changes]
    if tries.num is None:
        return changes
    costs, now = [], _reshaped(look, steps)
    for layer, change in changes:
        tried = {**steps, layer: steps[layer] + change}
        longer = _reshaped(look, tried)
        moved = _gone_along(now, longer, candidate, layer)
        costs.append(float(longer.judge([moved])[0]) + price * _squares(tried))
    return [changes[row] for row in np.argsort(costs)[: tries.num]]


def _gone_along(now: Look, longer: Look, candidate: Candidate, layer: int) -> Candidate:
    """Let a part that changed its length keep its joint with its parent, and what hangs from it follow."""
    tree, states = now.solution.tree, np.array(candidate.states)
    angle = states[layer, 0]
    old, new = now.solution.links, longer.solution.links
    own = old[layer].from_child[angle] - new[layer].from_child[angle]
    states[layer, 1:] += own
    for edge in tree.children(layer):
        end = new[edge.child].from_parent[angle] - old[edge.child].from_parent[angle]
        states[list(tree.below(edge.child)), 1:] += own + end
    return Candidate(tuple((int(a), int(x), int(y)) for a, x, y in states), candidate.order)


def look_with(look: Look, steps: Stretches) -> Look:
    """Look with parts stretched along their own axis; the other parts' templates are shared."""
    longer = _reshaped(look, steps)
    templates = _templates(look.searcher, look.templates, steps)
    return replace(longer, solution=replace(longer.solution, templates=templates))


def _reshaped(look: Look, steps: Stretches) -> Look:
    """Change the parts' shapes and joints: enough for judging poses."""
    shapes = {layer: shape_of(look.searcher, layer, step) for layer, step in steps.items() if step}
    solution, links = look.solution, dict(look.solution.links)
    for child, link in links.items():
        if link.edge.parent in shapes or child in shapes:
            links[child] = _moved(link, solution, shapes)
    return replace(look, solution=replace(solution, links=links), shapes=shapes)


def shape_of(searcher: Searcher, layer: int, step: int) -> Float[np.ndarray, "2 2"]:
    """Give the linear map that stretches a part by ``step`` steps along its axis."""
    along = searcher.along[layer]
    return np.asarray(np.eye(2) + (STEP**step - 1) * np.outer(along, along))


def _moved(link: Link, solution: Solution, shapes: Mapping[int, Float[np.ndarray, "2 2"]]) -> Link:
    """Give a link whose parts have changed shape."""
    ends = [
        joint_offsets(solution.images[layer], solution.templates, link.edge.at, shapes.get(layer, UNCHANGED))
        for layer in (link.edge.parent, link.edge.child)
    ]
    return replace(link, from_parent=ends[0], from_child=ends[1])


def _templates(searcher: Searcher, templates: Templates, steps: Stretches) -> Templates:
    """Put the templates of the stretched parts after the others; those of a part are made once per size and length."""
    start, count, area = templates.start.copy(), templates.count.copy(), templates.area.copy()
    pixels, weights, reach = [templates.pixels], [templates.weights], templates.reach
    number = len(templates.pixels)
    for layer, step in steps.items():
        if step:
            own = searcher.stretched_part(templates.scale, layer, step, shape_of(searcher, layer, step))
            start[layer], count[layer], area[layer] = own.start[0] + number, own.count[0], own.area[0]
            pixels.append(own.pixels)
            weights.append(own.weights)
            number, reach = number + len(own.pixels), max(reach, own.reach)
    return replace(
        templates, start=start, count=count, area=area, pixels=np.concatenate(pixels), weights=np.concatenate(weights),
        reach=reach,
    )  # fmt: skip
