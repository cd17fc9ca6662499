"""How large the puppet is in a picture that shows another pose than it was drawn in.

Then its rest box and the character's box have other shapes: arms that lie at the body make a box narrow, a step makes
it wide, and neither the boxes' areas nor their sides tell the size. So the reference frame is searched, coarsely, at
the sizes that areas and sides suggest, and around the best of them; the size counts at which the whole pose leaves
least of the picture unexplained.
"""

from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
from jaxtyping import Float

from wildpuppet.geometry import affine
from wildpuppet.machine import Machine, silent
from wildpuppet.pose.look import SIZE_STEP
from wildpuppet.pose.place import is_drawn_here, place, rest_box, size_of
from wildpuppet.pose.search import search, settings_for
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Puppet

COARSE = 2 / 3
"""Share of the search's pixels and angles with which sizes are tried."""
LEAST_PIXELS, LEAST_ANGLES = 40, 24
STEP = SIZE_STEP**2
"""Ratio between neighbouring sizes: from here the search's own steps of size lead on."""


def placed_at_size(
    puppet: Puppet, crops: Crops, settings: SearchSettings, machine: Machine
) -> Float[np.ndarray, "2 3"]:
    """Map canvas to the reference crop as ``place`` does, at the size at which the search explains the crop best."""
    placement = place(puppet, crops)
    if not settings.enabled or is_drawn_here(puppet, crops):
        return placement
    box, target = rest_box(puppet), np.asarray(crops.box_crop[crops.reference or 0], np.float64)
    guess = size_of(placement)
    sides = np.log(target[2:] / (box[2:] * guess)) / np.log(STEP)
    if np.abs(sides).max() < 1:
        return placement
    step = _best_step(puppet, crops, placement, sorted({0, *(round(float(side)) for side in sides)}), settings, machine)
    size = guess * STEP**step
    shift = target[:2] + target[2:] / 2 - size * (box[:2] + box[2:] / 2)
    return affine.scale_and_shift(size, (float(shift[0]), float(shift[1])))


def _best_step(
    puppet: Puppet,
    crops: Crops,
    placement: Float[np.ndarray, "2 3"],
    steps: list[int],
    settings: SearchSettings,
    machine: Machine,
) -> int:
    """Find the cheapest of the given steps, then go on from it downhill."""
    coarse = msgspec.structs.replace(
        settings_for(crops, settings),
        box_pixels=min(settings.box_pixels, max(LEAST_PIXELS, round(COARSE * settings.box_pixels))),
        angles=min(settings.angles, max(LEAST_ANGLES, round(COARSE * settings.angles))),
        num_best=1,
        coarse=0.0,
    )
    one_size = replace(crops, ordered=False)  # of drawings that share a canvas no other size is tried
    frame, quiet = np.array([crops.reference or 0]), replace(machine, progress=silent)

    @cache
    def cost(step: int) -> float:
        size = size_of(placement) * STEP**step
        found = search(puppet, one_size, placement, size, frame, coarse, quiet)
        return float(found.cost[0, 0]) * size**2  # in pixels: the search gives it per pixel of the puppet

    best = min(steps, key=cost)
    while True:
        machine.progress(0, 1)
        better = min((best - 1, best, best + 1), key=cost)
        if better == best:
            machine.progress(1, 1)
            return best
        best = better
