"""Choice over time: one hypothesis per frame, by Viterbi over each shot.

A limb swap often has the lower pixel cost in one frame; over time it would make two limbs jump. The path pays each
frame's whole-pose cost plus, between frames, how far and how much parts move and turn (truncated, so that a real jump
to a new drawing costs a bounded amount).
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.place import between, pose_vertices
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Hypotheses, Poses, Puppet


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
        _margins(hypotheses.cost, picked),
    )


def _pick_over_time(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, settings: SearchSettings
) -> Int[np.ndarray, "T"]:
    def vertices_at(frame: int) -> Float[np.ndarray, "N V 2"]:  # of all frames at once they would fill the memory
        return pose_vertices(puppet, hypotheses.crop_from_canvas[frame])

    size = float(np.median([np.ptp(vertices_at(frame)[0], axis=0).max() for frame in range(len(crops.frames))]))
    picked = np.zeros(len(crops.frames), np.int64)
    for shot in np.unique(crops.shot):
        index = np.flatnonzero(crops.shot == shot)
        starts = index[np.r_[True, np.diff(crops.drawing[index]) != 0]]
        steps = [
            settings.time_weight * least_movement(puppet, crops, (a, b), vertices_at(a), vertices_at(b)) / size
            for a, b in pairwise(starts.tolist())
        ]
        path = best_path(hypotheses.cost[starts], steps)
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
    limit = 0.15 * float(np.ptp(after[0], axis=0).max())
    per_layer = np.stack(
        [np.minimum(far[..., puppet.layer_of_vertex == layer], limit).mean(-1) for layer in range(puppet.num_layers)]
    )
    movement: Float[np.ndarray, "N N"] = per_layer.sum(0)
    return movement


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


def _margins(cost: Float[np.ndarray, "T N"], picked: Int[np.ndarray, "T"]) -> Float[np.ndarray, "T"]:
    """How much more the best other hypothesis costs; negative where time overruled the pixels."""
    if cost.shape[1] < 2:
        return np.full(len(cost), np.inf)
    others = cost.copy()
    rows = np.arange(len(cost))
    own = others[rows, picked].copy()
    others[rows, picked] = np.inf
    margins: Float[np.ndarray, "T"] = others.min(1) - own
    return margins
