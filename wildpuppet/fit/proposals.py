"""The search's hypotheses brought off their grid and judged again at a finer scale.

The search works at a character of some 70 pixels, on a grid of places and of 10 degree turns; two limbs that differ by
a shade or an outline cannot be told apart there. Each hypothesis is moved to its nearest minimum (parts as wholes) and
pays for what it leaves unexplained at a finer scale, so that a swap is decided by what the picture shows.
"""

import numpy as np
import torch
from jaxtyping import Float, Int

from wildpuppet.fit import curvature
from wildpuppet.fit.descent import descend, make_problem
from wildpuppet.fit.target import Target, target_at
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.evidence import evidence_of, unexplained_cost
from wildpuppet.pose.place import pose_vertices, rest_box
from wildpuppet.pose.springs import spring_costs
from wildpuppet.pose.tree import part_areas, tree_of
from wildpuppet.settings import FitSettings, SearchSettings
from wildpuppet.types import Crops, Hypotheses, Puppet


def refine(
    puppet: Puppet,
    crops: Crops,
    hypotheses: Hypotheses,
    frames: Int[np.ndarray, "n"],
    search: SearchSettings,
    settings: FitSettings,
    machine: Machine,
) -> Hypotheses:
    """Refine the hypotheses of the crops ``frames``, in whose order ``hypotheses`` are; returns them best first."""
    torch.set_num_threads(1)
    maps, orders, costs = (a.copy() for a in (hypotheses.crop_from_canvas, hypotheses.order, hypotheses.cost))
    for k, frame in enumerate(frames):
        before = frames[k - 1] if k else None
        if before is not None and crops.drawing[frame] == crops.drawing[before]:
            between = affine.compose(affine.invert(crops.video_from_crop[frame]), crops.video_from_crop[before])
            maps[k], orders[k], costs[k] = affine.compose(between[None, None], maps[k - 1]), orders[k - 1], costs[k - 1]
        else:
            image = crops.images[int(frame) : int(frame) + 1]
            maps[k], costs[k] = _refine_frame(puppet, image, maps[k], orders[k], costs[k], search, settings)
            rank = np.argsort(costs[k], kind="stable")
            maps[k], orders[k], costs[k] = maps[k][rank], orders[k][rank], costs[k][rank]
        machine.progress(k + 1, len(frames))
    return Hypotheses(maps, orders, costs)


def _refine_frame(
    puppet: Puppet,
    image: Int[np.ndarray, "1 H W 4"],
    maps: Float[np.ndarray, "N L 2 3"],
    orders: Int[np.ndarray, "N L"],
    costs: Float[np.ndarray, "N"],
    search: SearchSettings,
    settings: FitSettings,
) -> tuple[Float[np.ndarray, "N L 2 3"], Float[np.ndarray, "N"]]:
    count = int(np.isfinite(costs).sum())
    vertices = pose_vertices(puppet, maps[:count])
    size = float(np.ptp(vertices[0], axis=0).max())
    level = min(1.0, search.refine_pixels / size)
    one = target_at(image, level, settings.matte * settings.robust**2)
    target = Target(one.colour.expand(count, -1, -1, -1), one.cover_gain.expand(count, -1, -1), level)
    start = torch.from_numpy((vertices * level).astype(np.float32))
    problem = make_problem(puppet, target, orders[:count], start, settings)
    bones = curvature.Bones(puppet.layer_of_vertex, puppet, settings.hold_scale)
    found = descend(problem, start, search.refine_steps, bones, with_mesh=False).numpy().astype(np.float64)
    pixels = unexplained_cost(evidence_of(image[0], level), found, orders[:count], problem.mesh, problem.texture)
    refined = np.stack(
        [affine.closest_similarity(puppet.vertices[mine], found[:, mine] / level) for mine in _members(puppet)], 1
    )
    area = np.maximum(part_areas(puppet), 1e-6)
    seen_area = area.sum() * (size * level / max(1.0, float(rest_box(puppet)[2:].max()))) ** 2
    unit = float(np.sqrt(area / area.mean()).sum()) / seen_area
    springs = spring_costs(refined, tree_of(puppet), size, search)
    filled = np.concatenate([refined, maps[count:]])
    return filled, np.concatenate([unit * pixels + springs, costs[count:]])


def _members(puppet: Puppet) -> list[Int[np.ndarray, "n"]]:
    return [np.flatnonzero(puppet.layer_of_vertex == layer) for layer in range(puppet.num_layers)]
