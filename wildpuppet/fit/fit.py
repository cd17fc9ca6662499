"""The fit stage: from coarse poses to vertices, chunk by chunk, holds solved once.

A held drawing is solved on its first frame; its other frames show the same drawing seen by a camera that may have
moved, so the whole puppet is only shifted, turned and scaled there.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int

from wildpuppet.fit.descent import energies, make_problem
from wildpuppet.fit.pins import pinned_vertices, pins_of
from wildpuppet.fit.solve import BATCH, images_of, solve
from wildpuppet.fit.target import target_at
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.place import pose_vertices
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Fit, FitState, Keyframe, Poses, Puppet


def fit(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    frames: slice,
    settings: FitSettings,
    machine: Machine,
    keyframes: Sequence[Keyframe] = (),
) -> Fit:
    """Fit the frames ``crops.frames[frames]``; the slice must not split a held drawing (see ``spans_of``).

    What ``keyframes`` fix stays where it is in their frames; the other frames of their drawings follow them.
    Confidence is not known yet (``fit/confidence.py``): 1, and 0 in frames without the character.
    """
    torch.set_num_threads(1)  # the kernels have threads of their own; torch's slow small work down on a busy machine
    index = np.arange(*frames.indices(len(crops.frames)))
    fixed = {int(i): one for one in keyframes for i in np.flatnonzero(crops.frames[index] == one.frame)}
    first = _leaders(crops.drawing[index], sorted(fixed))
    is_first = first == np.arange(len(index))
    vertices = pose_vertices(puppet, poses.crop_from_canvas[index]).astype(np.float32)
    for i, keyframe in fixed.items():
        crop_from_video = affine.invert(crops.video_from_crop[index[i]])
        vertices[i] = pinned_vertices(puppet, keyframe, crop_from_video, vertices[i])
    results: dict[int, tuple[Float[np.ndarray, "V 2"], dict[str, float]]] = {}
    done = 0
    for held in (False, True):
        chosen = np.flatnonzero(is_first != held)
        for part in np.array_split(chosen, max(1, -(-len(chosen) // BATCH))) if len(chosen) else ():
            order, start = poses.order[index[part]], vertices[part]
            if held:
                posed = np.stack([results[int(i)][0] for i in first[part]])
                start = _start_of_held(puppet, crops, index[part], index[first[part]], posed, order, settings)
            pins = pins_of(puppet, [fixed.get(int(i)) for i in part])
            images = images_of(crops, index[part])
            solved = solve(puppet, images, start, order, settings, held, pins)
            results.update(zip((int(i) for i in part), solved, strict=True))
            done += len(part)
            machine.progress(done, len(index))
    ordered = [results[i] for i in range(len(index))]
    confidence = np.ones((len(index), len(puppet.vertices)), np.float32)
    confidence[[crops.state[i] == "lost" for i in index]] = 0.0
    return Fit(
        crops.frames[index],
        np.stack([vertices for vertices, _ in ordered]).astype(np.float32),
        poses.order[index],
        confidence,
        tuple(_state(crops, int(i), bool(leads)) for i, leads in zip(index, is_first, strict=True)),
        {name: np.array([terms[name] for _, terms in ordered]) for name in ordered[0][1]},
    )


def _leaders(drawing: Int[np.ndarray, "T"], fixed: list[int]) -> Int[np.ndarray, "T"]:
    """Say for each frame which one it follows: its drawing's first, or the nearest fixed frame of its drawing."""
    is_first = np.r_[True, np.diff(drawing) != 0]
    leaders = np.maximum.accumulate(np.where(is_first, np.arange(len(drawing)), 0))
    first = leaders.copy()
    for i in range(len(drawing) if fixed else 0):
        leaders[i] = min((k for k in fixed if first[k] == first[i]), key=lambda k: abs(k - i), default=first[i])
    return leaders


def join(parts: list[Fit]) -> Fit:
    """Put chunks together, in order."""
    return Fit(
        np.concatenate([part.frames for part in parts]),
        np.concatenate([part.vertices_crop for part in parts]),
        np.concatenate([part.order for part in parts]),
        np.concatenate([part.confidence for part in parts]),
        tuple(state for part in parts for state in part.state),
        {name: np.concatenate([part.losses[name] for part in parts]) for name in parts[0].losses},
    )


def _state(crops: Crops, index: int, is_first: bool) -> FitState:
    if crops.state[index] == "lost":
        return "lost"
    return "fitted" if is_first else "held"


def _start_of_held(
    puppet: Puppet,
    crops: Crops,
    index: Int[np.ndarray, "B"],
    first: Int[np.ndarray, "B"],
    posed: Float[np.ndarray, "B V 2"],
    order: Int[np.ndarray, "B L"],
    settings: FitSettings,
) -> Float[np.ndarray, "B V 2"]:
    """Start from the drawings' first frames, standing still in the video or in the crop, as the picture says.

    Under a still camera the first is exact. Under a moving one the second is nearly right: holds are recognised by
    crops that agree but for a few pixels.
    """
    crop_from_first = affine.compose(affine.invert(crops.video_from_crop[index]), crops.video_from_crop[first])
    starts = torch.from_numpy(np.stack([affine.apply(crop_from_first, posed), posed]).astype(np.float32))
    target = target_at(images_of(crops, index), settings.levels[0][0], settings.matte * settings.robust**2)
    scaled = starts * target.level
    still, moving = (energies(make_problem(puppet, target, order, start, settings), start)[0] for start in scaled)
    return torch.where((still <= moving)[:, None, None], starts[0], starts[1]).numpy()
