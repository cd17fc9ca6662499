"""Our recipe: a network that learns from the puppet's own renders and from the fits of the real frames at once.

Every step's batch holds made-up pictures with exact vertices (``poses.py``) and real ones with what the fit says of
them, moved and lit a little differently each time. It depends on the seed and the step's number alone, so a training
that was killed goes on from its checkpoint to exactly the weights that an unbroken one reaches.
"""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import msgspec
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from wildpuppet.deform.checkpoint import Progress, load_checkpoint, save_checkpoint
from wildpuppet.deform.learn import one_thread
from wildpuppet.deform.lesson import FINER, WHITE, Lesson, lesson_of
from wildpuppet.deform.model import Model
from wildpuppet.deform.poses import draw, in_light, sample_orders, sample_poses
from wildpuppet.deform.reader import PuppetNetwork, points_of
from wildpuppet.deform.skeleton import vertices_of
from wildpuppet.settings import TrainSettings
from wildpuppet.types import Crops, Fit, Puppet

OURS = TrainSettings(iterations=2000, batch=24, learning_rate=1.0e-3, code=96, encoder_pixels=96)
"""Our recipe's defaults, some four minutes on a quiet core; the other fields of ``TrainSettings`` are the paper's."""
TERMS = ("vertices", "points", "code")
REAL_SHARE = 0.25
"""Share of a batch that is real frames."""
SOFT = 0.02
"""Errors beyond this, in unit coordinates, count linearly."""
CODE_WEIGHT = 0.002
"""Weight of the code's own error beside that of the vertices (1) and of the points (1), in unit coordinates."""
TURN, SIZE, SHIFT = 0.12, 0.08, 0.12
"""How far real pictures are turned (radians), scaled (log) and shifted (unit coordinates), at most."""
WARM_STEPS, LAST_RATE = 50, 0.02
"""Steps in which the learning rate rises, and the share of it that is left at the end of a half cosine."""
CHECKPOINT_SECONDS = 10.0
RIDGE, RIDGE_SAMPLES = 0.3, 3000
"""The first guess of codes from points: ridge regression over so many made-up poses."""

Batch = tuple[Float[Tensor, "B 3 P P"], Float[Tensor, "B V 2"], Float[Tensor, "B V"], Float[Tensor, "m Z"]]
Tell = Callable[[int, int, dict[str, float]], None]
"""Called as tell(done, total, losses of this step), errors in crop pixels."""


def taught(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    rows: Int[np.ndarray, "D"],
    train: TrainSettings,
    hold_out: tuple[int, ...] = (),
    checkpoint: Path | None = None,
    tell: Tell | None = None,
) -> Model:
    """Train a model on the frames ``rows`` of a fit; raises as ``lesson_of`` and ``teach`` do."""
    lesson = lesson_of(puppet, crops, fit, rows, train.code, train.encoder_pixels)
    network, losses = teach(lesson, train, checkpoint, tell)
    return Model(puppet, crops.size, network, train, "ours", not crops.ordered, hold_out, losses)


def teach(
    lesson: Lesson, train: TrainSettings, checkpoint: Path | None = None, tell: Tell | None = None
) -> tuple[PuppetNetwork, dict[str, Float[np.ndarray, "S"]]]:
    """Train a network; give it in eval mode, with each term of the loss at each step (errors in crop pixels).

    Raises StoreError when the checkpoint is another training's, or cannot be written.
    """
    with one_thread():
        network = new_reader(lesson, train.seed)
        optimizer = torch.optim.Adam(network.parameters(), lr=train.learning_rate, fused=True)
        identity = _identity(lesson, network, train)
        found = load_checkpoint(checkpoint, network, optimizer, identity) if checkpoint else None
        progress = found or Progress(0, torch.zeros(train.iterations, len(TERMS)))
        saved = time.monotonic()
        for step in range(progress.step, train.iterations):
            progress.losses[step] = _step(network, optimizer, lesson, train, step)
            if tell:
                row = progress.losses[step].tolist()
                tell(step + 1, train.iterations, dict(zip(TERMS, row, strict=True)))
            if checkpoint and time.monotonic() - saved >= CHECKPOINT_SECONDS:
                save_checkpoint(checkpoint, network, optimizer, Progress(step + 1, progress.losses), identity)
                saved = time.monotonic()
    losses = {name: progress.losses[:, column].numpy() for column, name in enumerate(TERMS)}
    return network.eval(), losses


def new_reader(lesson: Lesson, seed: int) -> PuppetNetwork:
    """Build the network at its start; from exact points it would already give about the right codes."""
    points = points_of(lesson.skeleton)
    generator = torch.Generator().manual_seed(seed)
    network = PuppetNetwork(lesson.skeleton, lesson.code, points, lesson.pixels, generator)
    poses = sample_poses(lesson.known, RIDGE_SAMPLES, np.random.default_rng([seed, 1]))
    with torch.no_grad():
        placed = vertices_of(network.skeleton, torch.from_numpy(poses).float())[:, points].numpy()
        columns = np.concatenate([placed.reshape(len(placed), -1), np.ones((len(placed), 1))], 1).astype(np.float64)
        square = columns.T @ columns + RIDGE * np.eye(columns.shape[1])
        solved = np.linalg.solve(square, columns.T @ lesson.code.codes(poses))
        network.direct.weight.copy_(torch.from_numpy(solved[:-1].T).float())
        network.direct.bias.copy_(torch.from_numpy(solved[-1]).float())
    return network


def batch_of(lesson: Lesson, network: PuppetNetwork, batch: int, random: np.random.Generator) -> Batch:
    """Draw a batch: pictures, vertices, how far to trust them, and the codes of the made-up ones, which come first."""
    num_real = round(REAL_SHARE * batch)
    poses = sample_poses(lesson.known, batch - num_real, random)
    with torch.no_grad():
        placed = vertices_of(network.skeleton, torch.from_numpy(poses).float()).numpy()
    made = draw(lesson.studio, in_window(lesson, placed), sample_orders(lesson.known, len(poses), random), random)
    chosen = random.integers(len(lesson.real), size=num_real)
    pictures, vertices = [*made], [*placed]
    for number in chosen:
        picture, truth = moved(lesson, int(number), random)
        pictures.append(picture)
        vertices.append(truth)
    trust = np.concatenate([np.ones((len(made), placed.shape[1])), lesson.trust[chosen]])
    return (
        squared(np.stack(pictures), lesson.pixels),
        torch.from_numpy(np.stack(vertices)).float(),
        torch.from_numpy(trust).float(),
        torch.from_numpy(lesson.code.codes(poses)).float(),
    )


def in_window(lesson: Lesson, unit: Float[np.ndarray, "n V 2"]) -> Float[np.ndarray, "n V 2"]:
    """Take unit coordinates to pixels of the window."""
    size = np.array(lesson.size)
    return np.asarray(0.5 * (max(lesson.size) * unit + size) * (np.array(lesson.window) / size))


def squared(pictures: UInt8[np.ndarray, "n h w 3"], pixels: int) -> Float[Tensor, "n 3 P P"]:
    """Lay windows into the encoder's black square, 0..1."""
    height, width = pictures.shape[1:3]
    square = np.zeros((len(pictures), pixels, pixels, 3), np.uint8)
    top, left = (pixels - height) // 2, (pixels - width) // 2
    square[:, top : top + height, left : left + width] = pictures
    return torch.from_numpy(square).permute(0, 3, 1, 2).float() / 255.0


def moved(
    lesson: Lesson, number: int, random: np.random.Generator
) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "V 2"]]:
    """Turn, scale and shift a real picture and its vertices alike, and light it differently."""
    turn, size = random.uniform(-TURN, TURN), np.exp(random.uniform(-SIZE, SIZE))
    shift = random.uniform(-SHIFT, SHIFT, 2)
    linear = size * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    width, height = lesson.window
    centre, half = np.array([width, height]) / 2, np.array([0.5, 0.5])
    factor = linear / FINER  # the window's pixels from the finer picture's, whose pixel centres OpenCV counts in whole
    offset = centre - linear @ centre + 0.5 * max(width, height) * shift + factor @ half - half
    is_on_paper = lesson.studio.is_on_paper
    soft = cv2.GaussianBlur(lesson.real[number], (0, 0), 0.35 * FINER)
    picture = cv2.warpAffine(
        soft,
        np.concatenate([factor, offset[:, None]], 1),
        lesson.window,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT if is_on_paper else cv2.BORDER_REPLICATE,
        borderValue=(WHITE, WHITE, WHITE),
    )
    return in_light(picture.astype(np.float32), is_on_paper, random), lesson.truth[number] @ linear.T + shift


def _step(
    network: PuppetNetwork, optimizer: torch.optim.Adam, lesson: Lesson, train: TrainSettings, step: int
) -> Float[Tensor, "K"]:
    """Take one step; give the terms of its loss."""
    for group in optimizer.param_groups:
        group["lr"] = train.learning_rate * rate_at(step, train.iterations)
    pictures, vertices, trust, codes = batch_of(lesson, network, train.batch, np.random.default_rng([train.seed, step]))
    places, found = network.read(pictures)
    away = (soft_distance(network.decode(found), vertices) * trust).mean()
    points = (soft_distance(places, vertices[:, network.points]) * trust[:, network.points]).mean()
    code = functional.smooth_l1_loss(found[: len(codes)], codes)
    loss = away + points + CODE_WEIGHT * code
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
    pixels = 0.5 * max(lesson.size)
    return torch.stack([pixels * away.detach(), pixels * points.detach(), code.detach()])


def rate_at(step: int, total: int) -> float:
    """Give the share of the learning rate: up in a few steps, down in a half cosine."""
    fall = 0.5 * (1.0 + np.cos(np.pi * step / total))
    return float(min(1.0, (step + 1) / WARM_STEPS) * (LAST_RATE + (1.0 - LAST_RATE) * fall))


def soft_distance(found: Float[Tensor, "*n 2"], truth: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n"]:
    """Huber's distance between points: quadratic up to ``SOFT``."""
    squares = ((found - truth) ** 2).sum(-1)
    return torch.where(squares < SOFT**2, squares / (2 * SOFT), squares.clamp_min(SOFT**2).sqrt() - SOFT / 2)


def _identity(lesson: Lesson, network: PuppetNetwork, train: TrainSettings) -> str:
    """A digest of the settings and of all that is learnt from."""
    digest = hashlib.blake2b(msgspec.json.encode(train), digest_size=16)
    arrays = (lesson.truth, lesson.trust, lesson.real, lesson.studio.backgrounds, lesson.studio.texture.rgba.numpy())
    for array in (*arrays, network.mean.numpy(), network.directions.numpy()):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
