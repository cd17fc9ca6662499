"""Take a limb off and hang it anew where the rest of the pose leaves something to explain.

The first dynamic programme lets every part claim every pixel, so two legs like to stand on one leg and a hidden hand
asks for a place in the light. Here all else stays as it is: a pixel that the other parts explain well is worth little
to the limb, one in front of which another part lies is worth nothing, and one left unexplained is worth most. The
limb's best poses under these gains, by the same dynamic programme, have the composite's own cost (block coordinate
descent; exact but for the palette's rounding and for parts of the limb that cover each other).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float

from wildpuppet.pose import evidence as ev
from wildpuppet.pose import kernels
from wildpuppet.pose.dynamic import Solution, State, child_modes, descend, send
from wildpuppet.render.render import Mesh, render
from wildpuppet.render.texture import Texture

States = tuple[State, ...]
NOWHERE: Mapping[int, int] = {}
"""No part is held."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What a frame shows and how the puppet is drawn, at search scale.

    ``unit`` turns pixels into costs; ``wrong`` is each palette colour's disagreement; ``pulled`` is what given points
    add to each layer's costs.
    """

    evidence: ev.Evidence
    wrong: Float[np.ndarray, "C H W"]
    mesh: Mesh
    texture: Texture
    unit: float
    pulled: tuple[Float[np.ndarray, "K H W"], ...] = ()


@dataclass(frozen=True)
class Window:
    """Pixels ``left`` to ``right`` and ``top`` to ``bottom`` (not included): where a limb's pivots may lie."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index rows and columns of the whole map."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, pixels: int, height: int, width: int) -> "Window":
        """Grow on all sides, within the map."""
        return Window(
            max(0, self.left - pixels),
            max(0, self.top - pixels),
            min(width, self.right + pixels),
            min(height, self.bottom + pixels),
        )


def hung_anew(
    picture: Picture,
    solution: Solution,
    states: States,
    order: Sequence[int],
    vertices: Float[np.ndarray, "V 2"],
    head: int,
    free: Sequence[int],
    num: int,
    reach: Mapping[int, int] = NOWHERE,
    turns: Mapping[int, int] = NOWHERE,
) -> list[States]:
    """Find the ``num`` best poses of the limb that hangs from ``head``; ``vertices`` draw ``states`` (search pixels).

    The parts ``free`` (the limb's own among them) count as not there: their pixels are open to the limb. A
    part in ``reach`` stays within as many pixels of where it is, one in ``turns`` within as many steps of its angle.
    """
    limb = solution.tree.below(head)
    parent = solution.links[head].edge.parent
    window = _window(solution, states[parent], head)
    accumulated = list(solution.accumulated)
    for layer in limb:
        accumulated[layer] = _gains(picture, solution, order, vertices, layer, free, window)
        if layer in reach:
            accumulated[layer] += _away(states[layer], window, reach[layer])
        if layer in turns:
            accumulated[layer] += _turned_away(states[layer], len(accumulated[layer]), turns[layer])
    for edge in reversed(solution.tree.edges):
        if edge.parent in limb:
            send(accumulated, solution.links[edge.child])
    conditional = replace(solution, accumulated=tuple(accumulated))
    angle, x, y = states[parent]
    at = (angle, x - window.left, y - window.top)
    found = []
    for _, state in child_modes(conditional, head, at, num):
        moved = {head: state}
        descend(conditional, moved, head)
        placed = {layer: (a, x + window.left, y + window.top) for layer, (a, x, y) in moved.items()}
        found.append(tuple(placed.get(layer, state) for layer, state in enumerate(states)))
    return found


SEAT = 0.1
"""How far the root goes when it is seated anew, as a share of the window's larger side."""


def seated_anew(
    picture: Picture,
    solution: Solution,
    states: States,
    order: Sequence[int],
    vertices: Float[np.ndarray, "V 2"],
) -> States:
    """Find the best place of the root near by, all other parts staying where they are."""
    tree = solution.tree
    _, x, y = states[tree.root]
    num_angles, height, width = solution.accumulated[tree.root].shape
    window = Window(x, y, x + 1, y + 1).grown(max(1, round(SEAT * max(height, width))), height, width)
    costs = _gains(picture, solution, order, vertices, tree.root, [tree.root], window)
    columns, rows = np.arange(window.left, window.right), np.arange(window.top, window.bottom)
    for edge in tree.children(tree.root):
        link, child = solution.links[edge.child], states[edge.child]
        joint = np.array(child[1:]) + link.from_child[child[0]] - link.from_parent
        costs = costs + link.pull_of(np.abs(columns - joint[:, 0, None]))[:, None]
        costs += link.pull_of(np.abs(rows - joint[:, 1, None]))[:, :, None]
        costs += link.turn_of(child[0] - np.arange(num_angles))[:, None, None]
    angle, row, column = np.unravel_index(int(np.argmin(costs)), costs.shape)
    seated = (int(angle), int(columns[column]), int(rows[row]))
    return tuple(seated if layer == tree.root else state for layer, state in enumerate(states))


AWAY = 10.0
"""Cost of a place that a part may not take."""


def _away(state: State, window: Window, reach: int) -> Float[np.ndarray, "h w"]:
    rows = np.abs(np.arange(window.top, window.bottom) - state[2]) > reach
    columns = np.abs(np.arange(window.left, window.right) - state[1]) > reach
    return np.where(rows[:, None] | columns, np.float32(AWAY), np.float32(0))


def _turned_away(state: State, num_angles: int, most: int) -> Float[np.ndarray, "K 1 1"]:
    turn = (np.arange(num_angles) - state[0] + num_angles // 2) % num_angles - num_angles // 2
    return np.where(np.abs(turn) > most, np.float32(AWAY), np.float32(0))[:, None, None]


def _window(solution: Solution, parent: State, head: int) -> Window:
    """Bound where the limb's pivots can be: as far from its joint as its links are long, and a hinge open."""
    link = solution.links[head]
    joint = np.array(parent[1:]) + link.from_parent[parent[0]]

    def length(layer: int, arm: float) -> float:
        longest = arm
        for edge in solution.tree.children(layer):
            below = solution.links[edge.child]
            step = np.hypot(*below.from_parent[0]) + np.hypot(*below.from_child[0])
            longest = max(longest, length(edge.child, arm + float(step)))
        return longest

    radius = round(length(head, float(np.hypot(*link.from_child[0])))) + len(link.pull)
    height, width = solution.accumulated[head].shape[1:]
    left, top = (int(side) for side in np.clip(joint - radius, 0, (width - 1, height - 1)))
    right, bottom = (int(side) for side in np.clip(joint + radius + 1, (left + 1, top + 1), (width, height)))
    return Window(left, top, right, bottom)


def _gains(
    picture: Picture,
    solution: Solution,
    order: Sequence[int],
    vertices: Float[np.ndarray, "V 2"],
    layer: int,
    free: Sequence[int],
    window: Window,
) -> Float[np.ndarray, "K h w"]:
    """Sum what ``layer`` would change of the composite's cost at every angle and every place in the window."""
    templates, evidence = solution.templates, picture.evidence
    start, count = templates.start[layer], templates.count[layer]
    reach = int(np.abs(templates.pixels[start[0] : start[-1] + count[-1], :2]).max()) + 1
    seen = window.grown(reach, *evidence.matte.shape)
    behind, front = _drawn(picture, vertices, order, layer, free, seen)
    lab, matte = evidence.lab[seen.slices], evidence.matte[seen.slices]
    price = ev.behind_cost(matte)
    alpha = behind[..., 3]
    colour = behind[..., :3] * (ev.LAB_UNIT / np.maximum(alpha, 1e-3))[..., None]
    claimed = ev.disagreement(((lab - colour) ** 2).sum(-1)) + price
    now = alpha * claimed + (1 - alpha) * evidence.unexplained[seen.slices]
    height, width = window.bottom - window.top, window.right - window.left
    gain = np.full((len(picture.wrong), height + 2 * reach, width + 2 * reach), ev.BEHIND, np.float32)
    top, left = seen.top - window.top + reach, seen.left - window.left + reach
    inside = (slice(None), slice(top, top + len(matte)), slice(left, left + matte.shape[1]))
    gain[inside] = (1 - front[..., 3]) * (picture.wrong[:, *seen.slices] + (price - now))
    weights = templates.weights * np.float32(picture.unit)
    costs = kernels.template_costs(gain, templates.pixels, weights, start, count, reach, height, width)
    return costs + picture.pulled[layer][:, *window.slices] if picture.pulled else costs


def _drawn(
    picture: Picture,
    vertices: Float[np.ndarray, "V 2"],
    order: Sequence[int],
    layer: int,
    free: Sequence[int],
    seen: Window,
) -> Float[np.ndarray, "2 h w 4"]:
    """Draw, in a window, the parts that lie behind ``layer`` and those before it, without the ``free`` ones."""
    position = list(order).index(layer)
    opacity = np.zeros((2, len(order)), np.float32)
    opacity[0, list(order[:position])] = 1
    opacity[1, list(order[position + 1 :])] = 1
    opacity[:, list(free)] = 0
    moved = (vertices - (seen.left, seen.top)).astype(np.float32)
    size = (seen.right - seen.left, seen.bottom - seen.top)
    with torch.no_grad():
        drawn: Float[np.ndarray, "2 h w 4"] = render(
            torch.from_numpy(np.stack([moved, moved])),
            picture.mesh,
            picture.texture,
            torch.from_numpy(np.array([order, order])),
            size,
            torch.from_numpy(opacity),
        ).rgba.numpy()
    return drawn
