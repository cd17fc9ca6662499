"""Training the deformation network on the clip's own crops.

Two phases. First, for ``TrainSettings.distil`` of the steps, the network learns the poses that it is given (those of
the search; METHOD: fit, distil, refit). Then it lowers the paper's losses on the pictures. The paper has only the
second. Every step's batch depends on the seed and the step's number alone, so a training that was killed goes on
from its checkpoint to exactly the weights that an unbroken one reaches.
"""

import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from wildpuppet.deform.checkpoint import Progress, load_checkpoint, save_checkpoint
from wildpuppet.deform.network import DeformationNetwork, empty_network
from wildpuppet.deform.objective import TERMS, Objective, closest_similar, objective_of, scales_of, weighted
from wildpuppet.deform.pictures import Pictures, first_frames, read_pictures, read_small
from wildpuppet.errors import InputError
from wildpuppet.fit.energy import from_unit, to_unit
from wildpuppet.machine import Machine
from wildpuppet.pose.place import pose_vertices
from wildpuppet.settings import FitSettings, TrainSettings
from wildpuppet.types import Crops, Poses, Puppet

CHECKPOINT_SECONDS = 60.0
"""Time between checkpoints, each of a few hundred megabytes."""
BIAS_RATE = 0.1
"""The global bias learns at this share of the learning rate (Neural Mesh Renderer's reconstruction network)."""
DISTIL_WEIGHT = 1.0e5
"""Makes the first phase's loss as large as the second's: Adam's steps would leap where gradients suddenly grow."""
COLUMNS = (*TERMS, "distil")
Tell = Callable[[int, int, dict[str, float]], None]
"""Called as tell(done, total, losses of this step before weighting)."""


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained network: ``weights`` as in its state_dict, ``losses[name]`` one number per step before weighting."""

    weights: dict[str, Float[np.ndarray, "..."]]
    losses: dict[str, Float[np.ndarray, "S"]]


@dataclass(frozen=True, eq=False)
class _Lesson:
    """What a step draws its batch from, one row per usable drawing; ``poses`` in unit coordinates.

    ``rows`` are those drawings' rows in ``pictures.full``, ``small`` their pictures for the encoder.
    """

    pictures: Pictures
    rows: Int[np.ndarray, "D"]
    small: UInt8[Tensor, "D 3 P P"]
    poses: Float[Tensor, "D V 2"]
    order: Int[Tensor, "D L"]
    scales: Float[Tensor, "D"]


def learn(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    train: TrainSettings,
    fit: FitSettings,
    machine: Machine,
    checkpoint: Path | None = None,
    tell: Tell | None = None,
) -> Trained:
    """Train on the distinct drawings in which the character is not lost.

    Raises:
        InputError: the character is lost in all frames.
        StoreError: the checkpoint is another training's, or cannot be written.
    """
    device = device_of(machine)
    with one_thread():
        objective = objective_of(puppet, crops, poses, train.as_printed, device)
        lesson = _lesson(puppet, crops, poses, train)
        network = new_network(objective.base, crops.size, train).to(device)
        optimizer = _adam(network, train)
        losses = _run(network, optimizer, objective, lesson, train, fit, machine, checkpoint, tell)
    weights = {name: tensor.detach().cpu().numpy() for name, tensor in network.state_dict().items()}
    return Trained(weights, {name: losses[:, column].numpy() for column, name in enumerate(COLUMNS)})


def predict(crops: Crops, trained: Trained, train: TrainSettings, machine: Machine) -> Float[np.ndarray, "T V 2"]:
    """Find the vertices in every frame, crop pixels.

    Frames that show one drawing get the shape of its first frame: exactly where their windows are the same, else
    moved and scaled as a whole to where the network sees it.
    """
    small = read_small(crops, train.encoder_pixels)
    network = network_of(trained, crops.size, train).to(device_of(machine))
    with one_thread(), torch.no_grad():
        parts = [
            from_unit(network(part.to(network.base.device) / 255.0), crops.size)
            for part in torch.split(small, train.batch)
        ]
    vertices = torch.cat(parts).cpu().numpy().astype(np.float64)
    for frame, first in enumerate(first_frames(crops)):
        is_same = np.array_equal(crops.video_from_crop[frame], crops.video_from_crop[first])
        vertices[frame] = vertices[first] if is_same else closest_similar(vertices[first], vertices[frame])
    return np.asarray(vertices)


def new_network(base: Float[Tensor, "V 2"], size: tuple[int, int], train: TrainSettings) -> DeformationNetwork:
    """Build a network at its start; ``base`` in crop pixels."""
    return empty_network(to_unit(base.cpu(), size), train)


def network_of(trained: Trained, size: tuple[int, int], train: TrainSettings) -> DeformationNetwork:
    """Build a network with trained weights."""
    network = new_network(torch.from_numpy(np.array(trained.weights["base"])), size, train)
    network.load_state_dict({name: torch.from_numpy(np.array(array)) for name, array in trained.weights.items()})
    return network


def device_of(machine: Machine) -> torch.device:
    """Choose CUDA where it is asked for, or found by "auto"."""
    has_cuda = torch.cuda.is_available()
    if machine.device == "cuda" and not has_cuda:
        raise InputError("--device cuda: expected a CUDA device, found none; use --device auto or cpu")
    return torch.device("cuda" if has_cuda and machine.device != "cpu" else "cpu")


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch to one thread: sums do not depend on the machine, and the renderer has threads of its own."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _adam(network: DeformationNetwork, train: TrainSettings) -> torch.optim.Adam:
    slow = list(network.to_bias.parameters())
    rest = [parameter for name, parameter in network.named_parameters() if not name.startswith("to_bias.")]
    groups: list[dict[str, Any]] = [{"params": rest}, {"params": slow, "lr": BIAS_RATE * train.learning_rate}]
    return torch.optim.Adam(groups, lr=train.learning_rate, fused=True)


def _lesson(puppet: Puppet, crops: Crops, poses: Poses, train: TrainSettings) -> _Lesson:
    pictures = read_pictures(crops, train.encoder_pixels)
    posed = pose_vertices(puppet, poses.crop_from_canvas)
    is_usable = (np.array(crops.state) != "lost") & np.isfinite(posed).all((1, 2))
    rows = np.flatnonzero(is_usable[pictures.first])
    if not len(rows):
        raise InputError(f"expected the character in some of the {len(crops.frames)} frames, found it lost in all")
    frames = pictures.first[rows]
    return _Lesson(
        pictures,
        rows,
        pictures.small[torch.from_numpy(frames)],
        to_unit(torch.from_numpy(posed[frames]).float(), crops.size),
        torch.from_numpy(np.array(poses.order[frames])).long(),
        torch.from_numpy(scales_of(poses)[frames]).float(),
    )


def _run(
    network: DeformationNetwork,
    optimizer: torch.optim.Adam,
    objective: Objective,
    lesson: _Lesson,
    train: TrainSettings,
    fit: FitSettings,
    machine: Machine,
    checkpoint: Path | None,
    tell: Tell | None,
) -> Float[Tensor, "S K"]:
    """Take the steps that are left; the losses of all steps."""
    identity = _identity(network, lesson, train, fit)
    found = load_checkpoint(checkpoint, network, optimizer, identity) if checkpoint else None
    progress = found or Progress(0, torch.zeros(train.iterations, len(COLUMNS)))
    saved = time.monotonic()
    machine.progress(progress.step, train.iterations)
    for step in range(progress.step, train.iterations):
        loss, row = _loss(network, objective, lesson, train, fit, step)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        progress.losses[step] = row
        if checkpoint and time.monotonic() - saved >= CHECKPOINT_SECONDS:
            save_checkpoint(checkpoint, network, optimizer, Progress(step + 1, progress.losses), identity)
            saved = time.monotonic()
        machine.progress(step + 1, train.iterations)
        if tell:
            tell(step + 1, train.iterations, dict(zip(COLUMNS, row.tolist(), strict=True)))
    return progress.losses


def _loss(
    network: DeformationNetwork,
    objective: Objective,
    lesson: _Lesson,
    train: TrainSettings,
    fit: FitSettings,
    step: int,
) -> tuple[Tensor, Float[Tensor, "K"]]:
    """The weighted loss of one step's batch, and each term's mean before weighting."""
    drawn = np.random.default_rng([train.seed, step])
    drawings = np.sort(drawn.choice(len(lesson.rows), min(train.batch, len(lesson.rows)), replace=False))
    device, chosen, row = network.base.device, torch.from_numpy(drawings), torch.zeros(len(COLUMNS))
    vertices = network(lesson.small[chosen].to(device) / 255.0)
    away = ((vertices - lesson.poses[chosen].to(device)) ** 2).sum(-1).mean()
    row[-1] = away.detach()
    share = _paper_share(step, train)
    if share == 0.0:
        return DISTIL_WEIGHT * away, row
    target = torch.from_numpy(lesson.pictures.full[lesson.rows[drawings]]).to(device).float()
    order, scales = lesson.order[chosen].to(device), lesson.scales[chosen].to(device)
    terms = objective.terms(vertices, target, order, scales)
    row[:-1] = torch.stack([terms[name].detach().mean() for name in TERMS]).cpu()
    return share * weighted(terms, fit) + (1.0 - share) * DISTIL_WEIGHT * away, row


def _paper_share(step: int, train: TrainSettings) -> float:
    """Share of the paper's losses in a step: 0, then rising, over as many steps again, to 1."""
    first = round(train.distil * train.iterations)
    return min(1.0, max(0.0, (step - first + 1) / (first + 1)))


def _identity(network: DeformationNetwork, lesson: _Lesson, train: TrainSettings, fit: FitSettings) -> str:
    """A digest of the settings, the rest pose and the encoder's pictures."""
    digest = hashlib.blake2b(msgspec.json.encode([train, fit]), digest_size=16)
    for tensor in (network.base, lesson.poses, lesson.small):
        digest.update(tensor.detach().cpu().numpy().tobytes())
    return digest.hexdigest()
