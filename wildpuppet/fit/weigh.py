"""Drawings' hypotheses weighed by the fit's own energy: it sees what the search's few pixels cannot.

A spear upside down, or a foot under the other one, covers nearly the same pixels at the size at which poses are
searched, and descent does not find the way from one to the other. So the fit descends from every hypothesis that is
not much dearer than the best, and one that explains the drawing far better is taken (far: limbs in each other's place
can cost a little less, too). In a clip the choice over time decides (``pose/choose.py``).
"""

import numpy as np
import torch

from wildpuppet.fit.solve import images_of, solve, total
from wildpuppet.machine import Machine
from wildpuppet.pose.choose import margins
from wildpuppet.pose.place import pose_vertices
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Hypotheses, Poses, Puppet

LIKELY = 1.35
"""Hypotheses that cost up to so many times the best one's are weighed."""
BATCH = 8
"""Hypotheses solved together; a bound on memory."""


def weigh(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, frames: slice, settings: FitSettings, machine: Machine
) -> Poses:
    """Choose one hypothesis for each of the drawings ``frames``, each by itself; the first is the search's best."""
    index = np.arange(*frames.indices(len(crops.frames)))
    picked = np.zeros(len(index), np.int64)
    for row, t in enumerate(index):
        picked[row] = _pick(puppet, crops, hypotheses, int(t), settings)
        machine.progress(row + 1, len(index))
    return Poses(
        hypotheses.crop_from_canvas[index, picked],
        hypotheses.order[index, picked],
        hypotheses.cost[index, picked],
        margins(hypotheses.cost[index], picked),
    )


def _pick(puppet: Puppet, crops: Crops, hypotheses: Hypotheses, frame: int, settings: FitSettings) -> int:
    """Choose among a drawing's hypotheses, which come best first."""
    cost = hypotheses.cost[frame]
    num = int(np.searchsorted(cost, LIKELY * cost[0], "right"))
    if num < 2 or not settings.overrule:
        return 0
    torch.set_num_threads(1)  # as in fit.fit
    image = images_of(crops, np.array([frame]))
    starts = pose_vertices(puppet, hypotheses.crop_from_canvas[frame, :num]).astype(np.float32)
    energy = np.zeros(num)
    for first in range(0, num, BATCH):
        some = slice(first, min(num, first + BATCH))
        images = np.broadcast_to(image, (some.stop - first, *image.shape[1:]))
        solved = solve(puppet, images, starts[some], hypotheses.order[frame, some], settings)
        energy[some] = [total(terms, settings) for _, terms in solved]
    best = int(np.argmin(energy))
    return best if energy[best] < settings.overrule * energy[0] else 0
