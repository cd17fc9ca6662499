"""The confidence stage: how likely each vertex lies within a twentieth of the character's size of its true place.

``signs`` says what speaks for a vertex, ``calibration`` what that was worth on puppets' own renders with known truth.
A frame is ``doubtful`` where some part that is seen is more likely wrong than right.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.fit.calibration import probability
from wildpuppet.fit.signs import HIGH, LOW, NAMES, margin_of, picture_signs
from wildpuppet.fit.witness import Witness, size_in
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.types import Crops, Fit, Hypotheses, Poses, Puppet

DOUBTFUL = 0.5
"""Mean confidence of a part under which its frame is doubtful: it is more likely wrong than right."""
LEAST_PART = 0.02
"""Share of the puppet's vertices from which a part can make a frame doubtful."""
LEAST_SEEN = 0.25
"""Share of a part that must be seen for the same."""


def with_confidence(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, poses: Poses, fit: Fit, machine: Machine
) -> Fit:
    """Fill in confidence and name the doubtful frames; ``fit`` began with ``poses``, chosen of ``hypotheses``."""
    confidence = np.zeros(fit.vertices_crop.shape[:2], np.float32)
    states = list(fit.state)
    for t, signs in enumerate(signs_of(puppet, crops, hypotheses, poses, fit)):
        if fit.state[t] != "lost":
            confidence[t] = probability(signs)
            if _is_doubtful(puppet, signs, confidence[t]):
                states[t] = "doubtful"
        machine.progress(t + 1, len(confidence))
    return Fit(fit.frames, fit.vertices_crop, fit.order, confidence, tuple(states), fit.losses)


def signs_of(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, poses: Poses, fit: Fit
) -> Iterator[Float[np.ndarray, "V K"]]:
    """Give the signs of every frame in turn, in the order of ``signs.NAMES``."""
    witness = Witness(puppet)
    beside = _neighbours(crops)
    for t in range(len(fit.frames)):
        vertices = fit.vertices_crop[t].astype(np.float64)
        found = picture_signs(witness, crops.images[t : t + 1][0], vertices, fit.order[t])
        found["margin"] = margin_of(
            witness,
            hypotheses.crop_from_canvas[t],
            hypotheses.cost[t],
            poses.crop_from_canvas[t],
            found["seen_of_part"],
        )
        found["steady"] = _steady(witness, crops, fit, t, beside[t])
        yield np.stack([found[name] for name in NAMES], -1).clip(LOW, HIGH)


def _neighbours(crops: Crops) -> Int[np.ndarray, "T 2"]:
    """Find the last frame of the drawing before and the first of the one after, in the same shot; -1: there is none."""
    number = len(crops.frames)
    if not crops.ordered:
        return np.full((number, 2), -1)
    is_cut = np.r_[True, np.diff(crops.shot) != 0]
    is_first = is_cut | np.r_[True, np.diff(crops.drawing) != 0]
    starts = np.flatnonzero(is_first)
    group = np.cumsum(is_first) - 1
    ends = np.r_[starts[1:], number]
    before, after = starts - 1, np.where(ends < number, ends, -1)
    before = np.where(is_cut[starts], -1, before)
    after = np.where((after >= 0) & is_cut[after], -1, after)
    return np.stack([before[group], after[group]], 1)


def _steady(witness: Witness, crops: Crops, fit: Fit, t: int, beside: Int[np.ndarray, "2"]) -> Float[np.ndarray, "V"]:
    """Minus the distance from midway between the neighbours, in shares of the size; half the way from a single one."""
    here = fit.vertices_crop[t].astype(np.float64)
    ways = [_carried(crops, fit, int(other), t) - here for other in beside if other >= 0 and fit.state[other] != "lost"]
    if not ways:
        return np.zeros(len(here))
    return np.asarray(-np.linalg.norm(sum(ways, np.zeros_like(here)), axis=1) / 2 / size_in(witness, here))


def _carried(crops: Crops, fit: Fit, other: int, t: int) -> Float[np.ndarray, "V 2"]:
    """Bring another frame's vertices to crop t, standing still in the video or in the crop, whichever moves less."""
    between = affine.compose(affine.invert(crops.video_from_crop[t]), crops.video_from_crop[other])
    vertices = fit.vertices_crop[other].astype(np.float64)
    here = fit.vertices_crop[t]
    ways = (affine.apply(between, vertices), vertices)
    return min(ways, key=lambda way: float(np.abs(way - here).mean()))


def _is_doubtful(puppet: Puppet, signs: Float[np.ndarray, "V K"], confidence: Float[np.ndarray, "V"]) -> bool:
    """Say whether a part of some size that is seen is more likely wrong than right; hidden ones are guesses anyway."""
    layers, seen = puppet.layer_of_vertex, signs[:, NAMES.index("seen_of_part")]
    counts = np.bincount(layers, minlength=puppet.num_layers)
    shown = np.bincount(layers, seen, puppet.num_layers) / np.maximum(counts, 1)
    means = np.bincount(layers, confidence, puppet.num_layers) / np.maximum(counts, 1)
    judged = (counts >= LEAST_PART * len(layers)) & (shown >= LEAST_SEEN)
    return bool((means[judged] < DOUBTFUL).any())
