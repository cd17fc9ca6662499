"""One batch of drawings down the pyramid, from given vertices; and what a pose costs."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from wildpuppet.fit import curvature
from wildpuppet.fit.descent import LOSS_NAMES, Problem, descend, energies, make_problem
from wildpuppet.fit.pins import Pins
from wildpuppet.fit.target import target_at
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Puppet

Solved: TypeAlias = tuple[Float[np.ndarray, "V 2"], dict[str, float]]
"""Vertices (crop pixels) and each term of their energy before weighting."""
BATCH = 8
"""Frames or poses solved together; a bound on memory."""
STEADY = 0.97
"""A held frame leaves its place for an energy lower than this share only: a hold must not tremble."""


def images_of(crops: Crops, index: Int[np.ndarray, "B"]) -> UInt8[np.ndarray, "B H W 4"]:
    """Fetch the crops' pictures at ``index``."""
    return np.concatenate([crops.images[int(i) : int(i) + 1] for i in index])


def solve(
    puppet: Puppet,
    images: UInt8[np.ndarray, "B H W 4"],
    vertices: Float[np.ndarray, "B V 2"],
    order: Int[np.ndarray, "B L"],
    settings: FitSettings,
    held: bool = False,
    pins: Pins | None = None,
) -> list[Solved]:
    """Descend from ``vertices``; ``held``: the whole puppet moves alone."""
    current = torch.from_numpy(vertices)
    groups = np.zeros_like(puppet.layer_of_vertex) if held else puppet.layer_of_vertex
    bones = curvature.Bones(groups, puppet, settings.hold_scale)
    problem: Problem | None = None
    for level, bone_share, mesh_share in settings.levels:
        target = target_at(images, level, settings.matte * settings.robust**2)
        start = current * level
        problem = make_problem(puppet, target, order, start, settings)
        start = descend(problem, start, round(settings.steps * bone_share), bones, with_mesh=False, pins=pins)
        start = descend(problem, start, round(settings.steps * mesh_share), bones, with_mesh=not held, pins=pins)
        current = start / level
    assert problem is not None
    if held:
        current = _steady(problem, torch.from_numpy(vertices), current)
    _, _, terms = energies(problem, current * problem.target.level)
    found = current.numpy()
    return [(found[b], {name: float(value[b]) for name, value in terms.items()}) for b in range(len(found))]


def total(terms: Mapping[str, float | Float[np.ndarray, "*shape"]], settings: FitSettings) -> np.ndarray:
    """Weigh the terms of an energy; the data's two share a weight."""
    return np.asarray(sum(getattr(settings, name, settings.reconstruction) * terms[name] for name in LOSS_NAMES))


def _steady(problem: Problem, start: Float[Tensor, "B V 2"], found: Float[Tensor, "B V 2"]) -> Float[Tensor, "B V 2"]:
    """Keep each frame where it started unless the descent gained by it."""
    before, after = (energies(problem, vertices * problem.target.level)[0] for vertices in (start, found))
    return torch.where((after < STEADY * before)[:, None, None], found, start)
