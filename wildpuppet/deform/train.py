"""The stage behind ``fit.method = "network"``: train the deformation network on the clip, then read every frame."""

from pathlib import Path

import numpy as np
import torch

from wildpuppet.deform.learn import Trained, learn, one_thread, predict
from wildpuppet.deform.objective import TERMS, objective_of, scales_of
from wildpuppet.fit.energy import to_unit
from wildpuppet.machine import Machine
from wildpuppet.settings import FitSettings, TrainSettings
from wildpuppet.types import Crops, Fit, FitState, Poses, Puppet

BATCH = 8
"""Frames scored at a time."""


def train(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    train: TrainSettings,
    fit: FitSettings,
    machine: Machine,
    checkpoint: Path | None = None,
) -> Fit:
    """Train on the clip and fit all its frames; held drawings get exactly the same vertices.

    Raises:
        InputError: the character is lost in all frames.
        StoreError: the checkpoint is another training's, or cannot be written.
    """
    trained = learn(puppet, crops, poses, train, fit, machine, checkpoint)
    return fit_of(puppet, crops, poses, trained, train, machine)


def fit_of(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    trained: Trained,
    train: TrainSettings,
    machine: Machine,
) -> Fit:
    """Read every frame with a trained network and score what it says; confidence is 1, or 0 where nothing is seen."""
    vertices = predict(crops, trained, train, machine)
    objective = objective_of(puppet, crops, poses, train.as_printed, torch.device("cpu"))
    order, scales = torch.from_numpy(np.array(poses.order)).long(), torch.from_numpy(scales_of(poses)).float()
    found = torch.from_numpy(vertices).float()
    rows = []
    with one_thread(), torch.no_grad():
        for start in range(0, len(vertices), BATCH):
            batch = slice(start, start + BATCH)
            images = np.ascontiguousarray(crops.images[batch])
            target = torch.from_numpy(images[..., :3]).float()
            terms = objective.terms(to_unit(found[batch], crops.size), target, order[batch], scales[batch])
            rows.append(torch.stack([terms[name] for name in TERMS], -1).numpy())
    table, confidence = np.concatenate(rows).astype(np.float64), np.ones(vertices.shape[:2], np.float32)
    confidence[np.array(crops.state) == "lost"] = 0.0
    losses = {name: table[:, column] for column, name in enumerate(TERMS)}
    return Fit(crops.frames, vertices, poses.order, confidence, _states(crops), losses)


def _states(crops: Crops) -> tuple[FitState, ...]:
    """A frame that shows the drawing of an earlier one is held."""
    states: list[FitState] = []
    seen: set[int] = set()
    for state, drawing in zip(crops.state, crops.drawing.tolist(), strict=True):
        if state == "lost":
            states.append("lost")
        else:
            states.append("held" if drawing in seen else "fitted")
        seen.add(drawing)
    return tuple(states)
