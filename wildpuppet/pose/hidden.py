"""Parts that are covered: nothing in the picture says where they are, so they follow their neighbours.

In space they hang from their parents; in time they turn on from where they were last seen to where they are next seen,
as evenly as can be (Viterbi over their angle). Only poses count that explain the picture as well as the one that was
chosen, so that nothing comes to light that is not there. A part of which something shows is found in the same way, when
the pose that was chosen had hidden all of it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float

from wildpuppet.geometry import affine
from wildpuppet.pose.pieces import pieces_of
from wildpuppet.pose.shots import Shot, keep_orders
from wildpuppet.pose.tree import Edge, Tree, tree_of
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Hypotheses, Poses, Puppet

HIDDEN = 0.2
"""A part is hidden when less than this share of its mesh is seen, which reaches about as far again as its drawing."""
UNSEEN = 0.05
"""A part of which less than this share is seen moves freely; one of which more is moves only to a better place."""
ANGLES = 72
"""Turns of a hidden part that are tried."""
NO_WORSE = 0.02
"""A pose explains the picture as well as another when it costs no more than this, in units of an average part."""
STEADY, INERTIA = 0.1, 0.8
"""Cost of a part's turn from one drawing to the next, and of a change of it, per squared radian."""


def follow_hidden(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, poses: Poses, settings: SearchSettings
) -> Poses:
    """Let hidden parts of the chosen ``poses`` follow their neighbours; what stands alone (keyframes) stays."""
    if not (settings.time_weight and crops.ordered):
        return poses
    torch.set_num_threads(1)
    is_fixed = np.isfinite(hypotheses.cost).sum(1) == 1
    pieces = pieces_of(puppet)
    maps = poses.crop_from_canvas.astype(np.float64)
    tree = tree_of(pieces.puppet, puppet.layer_of_piece)
    drawing = np.r_[True, (np.diff(crops.drawing) != 0) | (np.diff(crops.shot) != 0)]
    first = np.maximum.accumulate(np.where(drawing, np.arange(len(drawing)), 0))
    order = pieces.parted(poses.order)
    for number in np.unique(crops.shot):
        index = np.flatnonzero(drawing & (crops.shot == number) & (np.array(crops.state) != "lost"))
        if len(index) < 2:
            continue
        shot = Shot(pieces.puppet, crops, settings, index, maps[index], order[index], is_fixed[index])
        keep_orders(shot)
        for edge in tree.edges:
            _turn_hidden(shot, tree, edge)
        maps[index], order[index] = shot.maps, shot.order
    whole_order = pieces.joined(order)
    moved = (maps != poses.crop_from_canvas).any((1, 2, 3)) | (whole_order != poses.order).any(1)
    held = np.flatnonzero(moved[first] & (first != np.arange(len(first))) & ~is_fixed)
    maps[held], whole_order[held] = maps[first[held]], whole_order[first[held]]
    return replace(poses, crop_from_canvas=maps, order=whole_order)


def _turn_hidden(shot: Shot, tree: Tree, edge: Edge) -> None:
    """Turn a part, with all that hangs from it, through the drawings in which all of that is hidden."""
    limb = list(tree.below(edge.child))
    seen = shot.seen()[:, limb].max(1)
    hidden = (seen < HIDDEN) & ~shot.is_fixed
    for run in _runs(hidden):
        rows = range(max(0, run.start - 2), min(len(hidden), run.stop + 2))
        candidates = [_turned(shot.maps[row], edge, limb) if row in run else shot.maps[row : row + 1] for row in rows]
        slack = np.where(seen < UNSEEN, NO_WORSE, 0.0)
        costs = [_gains(shot.costs(row, poses), slack[row]) for row, poses in zip(rows, candidates, strict=True)]
        path = steadiest_path(costs, [_turns(poses, edge) for poses in candidates])
        for row, poses, best in zip(rows, candidates, path, strict=True):
            shot.maps[row] = poses[best]


def _gains(costs: Float[np.ndarray, "B"], slack: float) -> Float[np.ndarray, "B"]:
    """Rule out what costs more than the first and ``slack``, count what costs less, take the rest for equal."""
    gains: Float[np.ndarray, "B"] = np.minimum(costs - costs[0] + slack, 0.0)
    return np.where(costs <= costs[0] + slack, gains, np.inf)


def steadiest_path(costs: list[Float[np.ndarray, "_"]], angles: list[Float[np.ndarray, "_"]]) -> list[int]:
    """Choose one angle per drawing: the cheapest path, when turns and changes of turn cost (Viterbi over pairs)."""
    total = costs[0][:, None] + costs[1][None] + STEADY * _turn(angles[0], angles[1]) ** 2
    came_from = []
    for t in range(2, len(costs)):
        before, now = _turn(angles[t - 2], angles[t - 1]), _turn(angles[t - 1], angles[t])
        through = total[:, :, None] + INERTIA * (now[None] - before[:, :, None]) ** 2
        came_from.append(through.argmin(0))
        total = through.min(0) + STEADY * now**2 + costs[t][None]
    last, best = np.unravel_index(int(total.argmin()), total.shape)
    path = [int(best), int(last)]
    for back in reversed(came_from):
        path.append(int(back[path[-1], path[-2]]))
    return path[::-1]


def _runs(marked: Bool[np.ndarray, "n"]) -> Iterator[range]:
    """List the runs of what is marked, unless that is all."""
    edges = np.flatnonzero(np.diff(np.r_[False, marked, False].astype(int)))
    for start, stop in edges.reshape(-1, 2).tolist():
        if stop - start < len(marked):
            yield range(start, stop)


def _turned(maps: Float[np.ndarray, "L 2 3"], edge: Edge, limb: list[int]) -> Float[np.ndarray, "B L 2 3"]:
    """Turn a limb about its joint to all angles; the pose as it is comes first."""
    radians = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    about = affine.similarity(np.ones(ANGLES), radians, np.zeros((ANGLES, 2)))
    child, at = affine.compose(about, maps[edge.child][None]), np.array([edge.at])
    child[:, :, 2] += (affine.apply(maps[edge.parent], at) - affine.apply(child, at))[:, 0]
    poses = np.repeat(maps[None], ANGLES + 1, 0)
    below = affine.compose(affine.invert(maps[edge.child][None]), maps[limb])
    poses[1:, limb] = affine.compose(child[:, None], below[None])
    return poses


def _turns(maps: Float[np.ndarray, "B L 2 3"], edge: Edge) -> Float[np.ndarray, "B"]:
    """Give the child's turns against its parent, radians."""
    return np.asarray(affine.turn_of(maps[:, edge.child]) - affine.turn_of(maps[:, edge.parent]))


def _turn(before: Float[np.ndarray, "n"], after: Float[np.ndarray, "m"]) -> Float[np.ndarray, "n m"]:
    """Give the turns between two drawings, radians."""
    return np.asarray((after[None] - before[:, None] + np.pi) % (2 * np.pi) - np.pi)
