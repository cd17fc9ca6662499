"""Carry what a person fixed in one frame to the frames around it, as hypotheses for the choice over time.

In the keyframe itself each of the search's poses is brought to the given points (``pose/reach.py``) and descends with
the points pinned; the one that explains the picture best is the keyframe's pose. From there frame after frame, both
ways, the search is asked again with the pose of the frame before to start from, and of what it finds the pose is taken
that costs and moves least, until the shot ends or a few drawings are done.
"""

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from wildpuppet.fit import curvature
from wildpuppet.fit.descent import descend, energies, make_problem
from wildpuppet.fit.pins import Pins, pinned_vertices, pins_of
from wildpuppet.fit.target import target_at
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.choose import least_movement
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.reach import reach, similarities
from wildpuppet.pose.search import Searcher, search_from, searcher_of
from wildpuppet.settings import FitSettings, SearchSettings
from wildpuppet.types import Crops, Followed, Hypotheses, Keyframe, Puppet

FOLLOWED_DRAWINGS = 8
"""How many drawings on each side are given the keyframe's pose; from there the choice over time carries on."""
DESCENT = FitSettings()
LEVELS = ((0.25, 16, 2), (0.5, 12, 1))
"""Crop scale, steps, and how many of the starts go on from there, the best ones."""

Pose = tuple[Float[np.ndarray, "L 2 3"], Int[np.ndarray, "L"]]
"""Crop from canvas of every part, and layers back to front."""


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
    searcher = searcher_of(puppet, placement, settings)
    key = int(np.searchsorted(crops.frames, keyframe.frame))
    found = {key: pose_of(puppet, crops, hypotheses, keyframe, key)}
    cost = {key: float(hypotheses.cost[key, 0])}
    walks = [list(_walk(crops, key, direction)) for direction in (1, -1)]
    for walk in walks:
        before = key
        for frame in walk:
            if crops.drawing[frame] == crops.drawing[before]:
                maps, order = found[before]
                found[frame], cost[frame] = (affine.compose(_between(crops, frame, before), maps), order), cost[before]
            else:
                found[frame], cost[frame] = _next_pose(searcher, crops, placement, found[before], before, frame)
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


def pose_of(puppet: Puppet, crops: Crops, hypotheses: Hypotheses, keyframe: Keyframe, key: int) -> Pose:
    """Find the whole pose of a keyframe: what is given, the rest as the picture and the hinges have it."""
    crop_from_video = affine.invert(crops.video_from_crop[key])
    known = np.flatnonzero(np.isfinite(hypotheses.cost[key]))
    maps, order = hypotheses.crop_from_canvas[key][known], hypotheses.order[key][known]
    if keyframe.order is not None:
        order = np.repeat(keyframe.order[None], len(order), 0)
    if keyframe.vertices_video is None:
        layers = puppet.layer_of_vertex[keyframe.corners[:, 0]]
        points = (puppet.vertices[keyframe.corners] * keyframe.weights[..., None]).sum(1)
        given = affine.apply(crop_from_video, keyframe.points_video)
        maps = np.stack([reach(puppet, one, layers, points, given) for one in maps])
    starts = pinned_vertices(puppet, keyframe, crop_from_video, pose_vertices(puppet, maps))
    pins = pins_of(puppet, [keyframe] * len(starts))
    return _descended(puppet, crops.images[key : key + 1][0], starts, order, pins)


def _walk(crops: Crops, key: int, direction: int) -> Iterator[int]:
    """List the frames on one side, nearest first, as far as the character is followed."""
    frame, drawings = key + direction, 0
    while crops.ordered and 0 <= frame < len(crops.frames) and crops.shot[frame] == crops.shot[key]:
        drawings += int(crops.drawing[frame] != crops.drawing[frame - direction])
        if drawings > FOLLOWED_DRAWINGS or crops.state[frame] == "lost":
            return
        yield frame
        frame += direction


def _between(crops: Crops, frame: int, before: int) -> Float[np.ndarray, "1 2 3"]:
    return affine.compose(affine.invert(crops.video_from_crop[frame]), crops.video_from_crop[before])[None]


def _next_pose(
    searcher: Searcher, crops: Crops, placement: Float[np.ndarray, "2 3"], last: Pose, before: int, frame: int
) -> tuple[Pose, float]:
    """Search from the last pose, standing still in the video or in the crop; give what costs and moves least."""
    puppet = searcher.puppet
    starts = [(affine.compose(_between(crops, frame, before), last[0]), last[1]), last]
    maps, order, cost = search_from(searcher, crops, placement, frame, starts)
    now = pose_vertices(puppet, maps)
    was = np.repeat(pose_vertices(puppet, last[0][None]), len(now), 0)
    size = float(np.ptp(was[0], axis=0).max())
    moved = searcher.settings.time_weight * least_movement(puppet, crops, (before, frame), was, now)[0] / size
    best = int((cost + moved).argmin())
    return (maps[best], order[best]), float(cost[best])


def _descended(
    puppet: Puppet,
    image: UInt8[np.ndarray, "H W 4"],
    starts: Float[np.ndarray, "B V 2"],
    order: Int[np.ndarray, "B L"],
    pins: Pins | None,
) -> Pose:
    """Let poses descend on one picture, whole parts only; give the best."""
    current = torch.from_numpy(starts.astype(np.float32))
    bones = curvature.Bones(puppet.layer_of_vertex, puppet, DESCENT.hold_scale)
    for level, steps, num_best in LEVELS:
        images = np.repeat(image[None], len(current), 0)
        target = target_at(images, level, DESCENT.matte * DESCENT.robust**2)
        problem = make_problem(puppet, target, order, current * level, DESCENT)
        moved = descend(problem, current * level, steps, bones, with_mesh=False, pins=pins)
        best = energies(problem, moved)[0].argsort()[:num_best]
        current, order = (moved / level)[best], order[best.numpy()]
        pins = None if pins is None else Pins(pins.allowed[best])
    return similarities(puppet, current[0].numpy()), order[0]
