"""Carry what a person fixed in one frame to the frames around it, as hypotheses for the choice over time.

In the keyframe itself the search is asked again with the given points pulling at their parts (``pose/pull.py``); in
its best pose the parts are then set to their points. From there frame after frame, both ways, the search is asked with
the pose of the frame before to start from, and of what it finds the pose is taken that costs and moves least, until
the shot ends or a few drawings are done.
"""

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, Int

from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.choose import least_movement
from wildpuppet.pose.look import Searcher
from wildpuppet.pose.place import between, pose_vertices
from wildpuppet.pose.pull import Pull
from wildpuppet.pose.search import search_from, searcher_of, settings_for
from wildpuppet.pose.similarity import placed, similarities
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Followed, Hypotheses, Keyframe, Puppet

FOLLOWED_DRAWINGS = 8
"""How many drawings on each side are given the keyframe's pose; from there the choice over time carries on."""

Pose = tuple[Float[np.ndarray, "P 2 3"], Int[np.ndarray, "L"]]
"""Crop from canvas of every piece, and layers back to front."""


def follow(
    puppet: Puppet,
    crops: Crops,
    placement: Float[np.ndarray, "2 3"],
    hypotheses: Hypotheses,
    keyframe: Keyframe,
    settings: SearchSettings,
    machine: Machine,
) -> Followed:
    """Pose the keyframe and carry it over its drawing and to the drawings around, both ways."""
    torch.set_num_threads(1)
    searcher = searcher_of(puppet, placement, settings_for(crops, settings))
    key = int(np.searchsorted(crops.frames, keyframe.frame))
    found = {key: _pose_of(searcher, crops, hypotheses, keyframe, key)}
    cost = {key: float(hypotheses.cost[key, 0])}
    walks = [list(_walk(crops, key, direction)) for direction in (1, -1)]
    for walk in walks:
        before = key
        for frame in walk:
            if crops.drawing[frame] == crops.drawing[before]:
                maps, order = found[before]
                found[frame], cost[frame] = (
                    (affine.compose(between(crops, before, frame)[None], maps), order),
                    cost[before],
                )
            else:
                found[frame], cost[frame] = _next_pose(searcher, crops, found[before], before, frame)
            before = frame
            machine.progress(len(found) - 1, sum(map(len, walks)))
    frames = np.array(sorted(found))
    return Followed(
        frames,
        np.stack([found[frame][0] for frame in frames.tolist()]),
        np.stack([found[frame][1] for frame in frames.tolist()]),
        np.array([cost[frame] for frame in frames.tolist()]),
        (crops.drawing[frames] == crops.drawing[key]) & (crops.shot[frames] == crops.shot[key]),
    )


def _pose_of(
    searcher: Searcher,
    crops: Crops,
    hypotheses: Hypotheses,
    keyframe: Keyframe,
    key: int,
) -> Pose:
    """Find the whole pose of a keyframe: what is given, the rest as the picture and the hinges have it."""
    pieces, crop_from_video = searcher.pieces, affine.invert(crops.video_from_crop[key])
    maps, order = hypotheses.crop_from_canvas[key], hypotheses.order[key]
    if keyframe.vertices_video is None:
        touched = pieces.piece_of_vertex[keyframe.corners[:, 0]]
        points = (pieces.whole.vertices[keyframe.corners] * keyframe.weights[..., None]).sum(1)
        given = affine.apply(crop_from_video, keyframe.points_video)
        starts = [(placed(one, touched, points, given), its) for one, its in zip(maps, order, strict=True)]
        maps, order, _ = search_from(searcher, crops, key, starts, Pull(touched, points, given))
        return placed(maps[0], touched, points, given), order[0] if keyframe.order is None else keyframe.order
    vertices = affine.apply(crop_from_video, keyframe.vertices_video)
    return similarities(pieces.puppet, vertices[pieces.vertex]), order[0] if keyframe.order is None else keyframe.order


def _walk(crops: Crops, key: int, direction: int) -> Iterator[int]:
    """List the frames on one side, nearest first, as far as the character is followed."""
    frame, drawings = key + direction, 0
    while crops.ordered and 0 <= frame < len(crops.frames) and crops.shot[frame] == crops.shot[key]:
        drawings += int(crops.drawing[frame] != crops.drawing[frame - direction])
        if drawings > FOLLOWED_DRAWINGS or crops.state[frame] == "lost":
            return
        yield frame
        frame += direction


def _next_pose(searcher: Searcher, crops: Crops, last: Pose, before: int, frame: int) -> tuple[Pose, float]:
    """Search from the last pose, standing still in the video or in the crop; give what costs and moves least."""
    puppet = searcher.pieces.whole
    starts = [(affine.compose(between(crops, before, frame)[None], last[0]), last[1]), last]
    maps, order, cost = search_from(searcher, crops, frame, starts)
    now = pose_vertices(puppet, maps)
    was = np.repeat(pose_vertices(puppet, last[0][None]), len(now), 0)
    size = float(np.ptp(was[0], axis=0).max())
    moved = searcher.settings.time_weight * least_movement(puppet, crops, (before, frame), was, now)[0] / size
    best = int((cost + moved).argmin())
    return (maps[best], order[best]), float(cost[best])
