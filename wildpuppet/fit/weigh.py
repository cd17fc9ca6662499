"""Drawings' hypotheses weighed by the fit's own energy: it sees what the search's few pixels cannot.

A spear upside down, or a foot under the other one, covers nearly the same pixels at the size at which poses are
searched, and descent does not find the way from one to the other. So the fit descends from every hypothesis that is
not much dearer than the best, down to the last level but one, and one that explains the drawing clearly better is
taken. Limbs that trade places are no matter for it: another pose can cost less than the right one there, and the search
tells twins by their shades. In a clip the choice over time decides (``pose/choose.py``).
"""

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from msgspec import structs

from wildpuppet.fit.solve import BATCH, solve, total
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.choose import margins
from wildpuppet.pose.pieces import pieces_of
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.templates import mean_colours, part_images
from wildpuppet.pose.tree import part_areas, tree_of
from wildpuppet.pose.twins import Pair, twin_limbs
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Hypotheses, Poses, Puppet

LIKELY = 1.35
"""Hypotheses that cost up to so many times the best one's are weighed."""


def weigh(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, frames: slice, settings: FitSettings, machine: Machine
) -> Poses:
    """Choose one hypothesis for each of the drawings ``frames``, each by itself; the first is the search's best."""
    torch.set_num_threads(1)  # as in fit.fit
    settings = structs.replace(settings, levels=settings.levels[:-1] or settings.levels)
    twins, middles = _twins_of(puppet)
    index = np.arange(*frames.indices(len(crops.frames)))
    picked = np.zeros(len(index), np.int64)
    for row, t in enumerate(index):
        cost, maps = hypotheses.cost[t], hypotheses.crop_from_canvas[t]
        traded = _traded(affine.apply(maps, middles[:, None])[:, :, 0], twins)
        likely = np.flatnonzero((cost <= LIKELY * cost[0]) & ~traded)
        if len(likely) > 1:
            energy = _energies(puppet, crops.images[int(t) : int(t) + 1], hypotheses, int(t), likely, settings)
            best = int(np.argmin(energy))
            picked[row] = likely[best] if energy[best] < settings.overrule * energy[0] else 0
        machine.progress(row + 1, len(index))
    return Poses(
        hypotheses.crop_from_canvas[index, picked],
        hypotheses.order[index, picked],
        hypotheses.cost[index, picked],
        margins(hypotheses.cost[index], picked),
    )


def _twins_of(puppet: Puppet) -> tuple[list[Pair], Float[np.ndarray, "P 2"]]:
    """Pair the pieces that can be taken for one another, as the search does; give every piece's middle at rest."""
    pieces = pieces_of(puppet).puppet
    tree, colours = tree_of(pieces, puppet.layer_of_piece), mean_colours(part_images(pieces))
    middles = [pieces.vertices[pieces.layer_of_vertex == piece].mean(0) for piece in range(pieces.num_layers)]
    return twin_limbs(tree, part_areas(pieces), colours), np.stack(middles)


def _traded(places: Float[np.ndarray, "N P 2"], twins: list[Pair]) -> Bool[np.ndarray, "N"]:
    """Say in which poses some twins lie nearer to each other's place in the first pose than to their own."""
    traded = np.zeros(len(places), np.bool_)
    for first, second in twins:
        a, b = list(first), list(second)
        own = np.linalg.norm(places[:, a + b] - places[0, a + b], axis=-1).sum(1)
        other = np.linalg.norm(places[:, a + b] - places[0, b + a], axis=-1).sum(1)
        traded |= other < own
    return traded


def _energies(
    puppet: Puppet,
    image: UInt8[np.ndarray, "1 H W 4"],
    hypotheses: Hypotheses,
    frame: int,
    rows: Int[np.ndarray, "n"],
    settings: FitSettings,
) -> Float[np.ndarray, "n"]:
    """Fit one drawing from some of its hypotheses; give the energies."""
    starts = pose_vertices(puppet, hypotheses.crop_from_canvas[frame, rows]).astype(np.float32)
    energies: list[float] = []
    for first in range(0, len(rows), BATCH):
        some = slice(first, first + BATCH)
        images = np.broadcast_to(image, (len(rows[some]), *image.shape[1:]))
        solved = solve(puppet, images, starts[some], hypotheses.order[frame, rows[some]], settings)
        energies += [float(total(terms, settings)) for _, terms in solved]
    return np.array(energies)
