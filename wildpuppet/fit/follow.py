"""Carry what a person fixed in one frame to the frames around it, as hypotheses for the choice over time.

In the keyframe itself each of the search's poses is brought to the given points (``pose/reach.py``) and descends with
the points pinned; the one that explains the picture best is the keyframe's pose. From there frame after frame, both
ways, the pose of the frame before descends on the next picture, coarsely and with whole parts only, until the shot
ends or a few drawings are done. What comes out is judged as the search judges, so a pose that lost its way costs much.
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
from wildpuppet.pose.evidence import evidence_of, lab_texture, unexplained_cost
from wildpuppet.pose.place import pose_vertices, rest_box, size_of
from wildpuppet.pose.reach import reach, similarities
from wildpuppet.pose.tree import part_areas
from wildpuppet.render.render import mesh_of
from wildpuppet.render.texture import texture_at
from wildpuppet.settings import FitSettings, SearchSettings
from wildpuppet.types import Crops, Followed, Hypotheses, Keyframe, Puppet

FOLLOWED_DRAWINGS = 8
"""How many drawings on each side are given the keyframe's pose; from there the choice over time carries on."""
DESCENT = FitSettings()
LEVELS = ((0.25, 16), (0.5, 12))
"""Crop scale and steps."""

Pose = tuple[Float[np.ndarray, "V 2"], Int[np.ndarray, "L"]]
"""Vertices in crop pixels and layers back to front."""


def follow(
    puppet: Puppet,
    crops: Crops,
    hypotheses: Hypotheses,
    keyframe: Keyframe,
    settings: SearchSettings,
    machine: Machine,
) -> Followed:
    """Pose the keyframe and carry it over its drawing and to the drawings around, both ways."""
    torch.set_num_threads(1)
    key = int(np.searchsorted(crops.frames, keyframe.frame))
    found = {key: pose_of(puppet, crops, hypotheses, keyframe, key)}
    is_fixed = {key}
    walks = [list(_walk(crops, key, direction)) for direction in (1, -1)]
    for walk in walks:
        path = [key]
        for frame in walk:
            before = path[-1]
            if crops.drawing[frame] == crops.drawing[before]:
                vertices, order = found[before]
                found[frame] = affine.apply(_between(crops, frame, before), vertices), order
                is_fixed |= {frame} & set(_drawing_of(crops, key))
            else:
                found[frame] = _next_pose(puppet, crops, [found[index] for index in path[-2:]], path[-2:], frame)
            path.append(frame)
            machine.progress(len(found) - 1, sum(map(len, walks)))
    frames = sorted(found)
    maps = similarities(puppet, np.stack([found[frame][0] for frame in frames]))
    order = np.stack([found[frame][1] for frame in frames])
    pairs = zip(frames, maps, order, strict=True)
    cost = [_price(puppet, crops, hypotheses, frame, one, its, settings) for frame, one, its in pairs]
    return Followed(np.array(frames), maps, order, np.array(cost), np.array([frame in is_fixed for frame in frames]))


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
    vertices, energy = _descended(puppet, crops.images[key : key + 1][0], starts, order, pins)
    best = int(energy.argmin())
    return vertices[best], order[best]


def _walk(crops: Crops, key: int, direction: int) -> Iterator[int]:
    """List the frames on one side, nearest first, as far as the character is followed."""
    frame, drawings = key + direction, 0
    while crops.ordered and 0 <= frame < len(crops.frames) and crops.shot[frame] == crops.shot[key]:
        drawings += int(crops.drawing[frame] != crops.drawing[frame - direction])
        if drawings > FOLLOWED_DRAWINGS or crops.state[frame] == "lost":
            return
        yield frame
        frame += direction


def _drawing_of(crops: Crops, key: int) -> list[int]:
    return np.flatnonzero((crops.drawing == crops.drawing[key]) & (crops.shot == crops.shot[key])).tolist()


def _between(crops: Crops, frame: int, before: int) -> Float[np.ndarray, "2 3"]:
    return affine.compose(affine.invert(crops.video_from_crop[frame]), crops.video_from_crop[before])


def _next_pose(puppet: Puppet, crops: Crops, poses: list[Pose], frames: list[int], frame: int) -> Pose:
    """Descend from the last pose, standing still in the video or in the crop, or moving on as it did."""
    (last, order), before = poses[-1], frames[-1]
    starts = [affine.apply(_between(crops, frame, before), last), last]
    if len(poses) > 1:
        earlier = affine.apply(_between(crops, frame, frames[-2]), poses[-2][0])
        starts += [2 * starts[0] - earlier, 2 * last - poses[-2][0]]
    batch = pose_vertices(puppet, similarities(puppet, np.stack(starts)))
    orders = np.repeat(order[None], len(starts), 0)
    vertices, energy = _descended(puppet, crops.images[frame : frame + 1][0], batch, orders, None)
    return vertices[int(energy.argmin())], order


def _descended(
    puppet: Puppet,
    image: UInt8[np.ndarray, "H W 4"],
    starts: Float[np.ndarray, "B V 2"],
    order: Int[np.ndarray, "B L"],
    pins: Pins | None,
) -> tuple[Float[np.ndarray, "B V 2"], Float[np.ndarray, "B"]]:
    """Let poses descend on one picture, whole parts only; give them and their energies."""
    current = torch.from_numpy(starts.astype(np.float32))
    images = np.repeat(image[None], len(starts), 0)
    bones = curvature.Bones(puppet.layer_of_vertex, puppet, DESCENT.hold_scale)
    energy = torch.zeros(len(starts))
    for level, steps in LEVELS:
        target = target_at(images, level, DESCENT.matte * DESCENT.robust**2)
        problem = make_problem(puppet, target, order, current * level, DESCENT)
        moved = descend(problem, current * level, steps, bones, with_mesh=False, pins=pins)
        energy, _, _ = energies(problem, moved)
        current = moved / level
    return current.numpy().astype(np.float64), energy.numpy()


def _price(
    puppet: Puppet,
    crops: Crops,
    hypotheses: Hypotheses,
    frame: int,
    crop_from_canvas: Float[np.ndarray, "L 2 3"],
    order: Int[np.ndarray, "L"],
    settings: SearchSettings,
) -> float:
    """Cost a pose as the search does its own: the best one's cost, and what this one leaves unexplained beyond it.

    The best one descends first: it lies on the search's grid, and would lose to any pose that does not.
    """
    image = crops.images[frame : frame + 1][0]
    best, its_order = hypotheses.crop_from_canvas[frame, 0], hypotheses.order[frame, 0]
    size = float(np.mean([size_of(one) for one in best]))
    search_from_crop = settings.box_pixels / max(1.0, float(rest_box(puppet)[2:].max()) * size)
    evidence = evidence_of(image, search_from_crop)
    areas = part_areas(puppet) * (size * search_from_crop) ** 2
    unit = float(np.sqrt(areas / areas.mean()).sum() / areas.sum())
    rival, _ = _descended(puppet, image, pose_vertices(puppet, best[None]), its_order[None], None)
    vertices = np.concatenate([rival, pose_vertices(puppet, crop_from_canvas[None])]) * search_from_crop
    texture = lab_texture(texture_at(puppet, size * search_from_crop))
    left = unexplained_cost(evidence, vertices, np.stack([its_order, order]), mesh_of(puppet), texture)
    return float(hypotheses.cost[frame, 0] + unit * (left[1] - left[0]))
