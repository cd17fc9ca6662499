"""Choice over time: one hypothesis per frame, by Viterbi over each shot.

A limb swap often has the lower pixel cost in one frame; over time it would make two limbs jump. The path pays each
frame's whole-pose cost plus, between frames, how far and how much parts move and turn (truncated, so that a real jump
to a new drawing costs a bounded amount), plus how much their movement changes: where two limbs that look alike pass
each other they are near enough to be exchanged, but they would both have to turn back.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.place import between, pose_vertices
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Hypotheses, Poses, Puppet

LIMIT = 0.15
"""Movement of a vertex beyond which it costs no more, as a share of the character's size."""
INERTIA = 2.0
"""Cost of a change of movement against that of the movement itself."""


def choose(puppet: Puppet, crops: Crops, hypotheses: Hypotheses, settings: SearchSettings, machine: Machine) -> Poses:
    """Choose one hypothesis per frame; ``hypotheses`` covers all frames in order.

    Unordered drawings take each frame's best. Frames of one drawing (a hold) take one choice together.
    """
    if settings.time_weight and crops.ordered:
        picked = _pick_over_time(puppet, crops, hypotheses, settings)
    else:
        picked = np.zeros(len(crops.frames), np.int64)
    rows = np.arange(len(picked))
    machine.progress(len(picked), len(picked))
    return Poses(
        hypotheses.crop_from_canvas[rows, picked],
        hypotheses.order[rows, picked],
        hypotheses.cost[rows, picked],
        margins(hypotheses.cost, picked),
    )


def _pick_over_time(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, settings: SearchSettings
) -> Int[np.ndarray, "T"]:
    @lru_cache(maxsize=3)  # of all frames at once they would fill the memory
    def vertices_at(frame: int) -> Float[np.ndarray, "N V 2"]:
        return pose_vertices(puppet, hypotheses.crop_from_canvas[frame])

    size = float(np.median([np.ptp(vertices_at(frame)[0], axis=0).max() for frame in range(len(crops.frames))]))
    picked = np.zeros(len(crops.frames), np.int64)
    sample = _sample_of(puppet)
    for shot in np.unique(crops.shot):
        index = np.flatnonzero(crops.shot == shot)
        starts = index[np.r_[True, np.diff(crops.drawing[index]) != 0]]
        unit, frames = settings.time_weight / size, starts.tolist()
        steps = [
            unit * least_movement(puppet, crops, (a, b), vertices_at(a), vertices_at(b)) for a, b in pairwise(frames)
        ]
        changes = (
            INERTIA * unit * _change(puppet, crops, sample, three, [vertices_at(frame) for frame in three])
            for three in zip(frames, frames[1:], frames[2:], strict=False)
        )
        path = steadiest_path(hypotheses.cost[starts], steps, changes)
        picked[index] = path[np.searchsorted(starts, index, side="right") - 1]
    return picked


def least_movement(
    puppet: Puppet,
    crops: Crops,
    frames: tuple[int, int],
    before: Float[np.ndarray, "N V 2"],
    after: Float[np.ndarray, "N V 2"],
) -> Float[np.ndarray, "N N"]:
    """Movement in the video or in the crop, whichever is less.

    Where a camera follows the character all of it moves in the video, by more than any limb, but not in the crop.
    """
    ways = (between(crops, *frames), affine.scale_and_shift(1.0, (0.0, 0.0)))
    return min((_movement(puppet, way, before, after) for way in ways), key=lambda movement: float(movement.min()))


def _movement(
    puppet: Puppet,
    after_from_before: Float[np.ndarray, "2 3"],
    before: Float[np.ndarray, "N V 2"],
    after: Float[np.ndarray, "N V 2"],
) -> Float[np.ndarray, "N N"]:
    """Mean movement of the vertices between two frames' hypotheses, each vertex's share bounded, crop pixels."""
    moved = affine.apply(after_from_before[None], before)
    far = np.linalg.norm(moved[:, None] - after[None], axis=-1)
    limit = LIMIT * float(np.ptp(after[0], axis=0).max())
    per_layer = np.stack(
        [np.minimum(far[..., puppet.layer_of_vertex == layer], limit).mean(-1) for layer in range(puppet.num_layers)]
    )
    movement: Float[np.ndarray, "N N"] = per_layer.sum(0)
    return movement


SAMPLE = 12
"""Vertices of each part that stand for it."""


def _change(
    puppet: Puppet,
    crops: Crops,
    sample: Int[np.ndarray, "n"],
    frames: tuple[int, int, int],
    vertices: Sequence[Float[np.ndarray, "N V 2"]],
) -> Float[np.ndarray, "N N N"]:
    """Change of the sampled vertices' movement through three frames, in the video or in the crop, whichever is less."""
    layers = puppet.layer_of_vertex[sample]
    weights = 1 / np.bincount(layers, minlength=puppet.num_layers)[layers]
    first, second, third = (at[:, sample] for at in vertices)
    limit = LIMIT * float(np.ptp(vertices[2][0], axis=0).max())

    def change(before: Float[np.ndarray, "N n 2"], now: Float[np.ndarray, "N n 2"]) -> Float[np.ndarray, "N N N"]:
        midway = before[:, None] - 2 * now[None]
        far = np.linalg.norm(midway[:, :, None] + third, axis=-1)
        return np.asarray(np.minimum(far, limit) @ weights)

    still = [
        affine.apply(between(crops, frame, frames[2])[None], at)
        for frame, at in zip(frames, (first, second), strict=False)
    ]
    ways = (change(still[0], still[1]), change(first, second))
    return min(ways, key=lambda way: float(way.min()))


def _sample_of(puppet: Puppet) -> Int[np.ndarray, "n"]:
    """Choose up to ``SAMPLE`` vertices of each part, evenly."""
    chosen = []
    for layer in range(puppet.num_layers):
        mine = np.flatnonzero(puppet.layer_of_vertex == layer)
        chosen.append(mine[np.unique(np.linspace(0, len(mine) - 1, min(SAMPLE, len(mine))).round().astype(np.int64))])
    return np.concatenate(chosen)


def steadiest_path(
    costs: Float[np.ndarray, "T N"],
    steps: list[Float[np.ndarray, "N N"]],
    changes: Iterable[Float[np.ndarray, "N N N"]],
) -> Int[np.ndarray, "T"]:
    """Find the cheapest path when three in a row cost as well (Viterbi over pairs).

    ``changes[t][i, j, k]`` is the cost of i at t, j at t + 1 and k at t + 2.
    """
    if len(costs) < 3:
        return best_path(costs, steps)
    total, came_from = costs[0][:, None] + costs[1] + steps[0], []
    for cost, step, change in zip(costs[2:], steps[1:], changes, strict=True):
        through = total[:, :, None] + change
        came_from.append(through.argmin(0))
        total = through.min(0) + step + cost
    before, last = np.unravel_index(int(total.argmin()), total.shape)
    path = [int(last), int(before)]
    for back in reversed(came_from):
        path.append(int(back[path[-1], path[-2]]))
    return np.array(path[::-1], np.int64)


def best_path(costs: Float[np.ndarray, "T N"], steps: list[Float[np.ndarray, "N N"]]) -> Int[np.ndarray, "T"]:
    """Find the cheapest path (Viterbi); ``steps[t][i, j]`` is the cost of going from i at t to j at t + 1."""
    total, came_from = costs[0], []
    for cost, step in zip(costs[1:], steps, strict=True):
        through = total[:, None] + step
        came_from.append(through.argmin(0))
        total = through.min(0) + cost
    path = [int(total.argmin())]
    for back in reversed(came_from):
        path.append(int(back[path[-1]]))
    return np.array(path[::-1], np.int64)


def margins(cost: Float[np.ndarray, "T N"], picked: Int[np.ndarray, "T"]) -> Float[np.ndarray, "T"]:
    """How much more the best other hypothesis costs; negative where time, or the fit, overruled the search."""
    if cost.shape[1] < 2:
        return np.full(len(cost), np.inf)
    others = cost.copy()
    rows = np.arange(len(cost))
    own = others[rows, picked].copy()
    others[rows, picked] = np.inf
    margins: Float[np.ndarray, "T"] = others.min(1) - own
    return margins
