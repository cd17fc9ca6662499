"""Train the deforming auto-encoder on some drawings; ask it for pictures and correspondences.

L = |seen - drawing|^2 (mean, 0..1) + 1e-3 |warp's offsets' differences| (total variation, mean) + 0.01 (batch mean of
the warp - identity)^2, as in Shu et al. 2018 with weights for means instead of sums; Adam, drawings shifted by a few
pixels so that the few there are do not wear out. Each step's batch depends on the seed and the step alone.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from wildpuppet.correspond.baselines import sampled
from wildpuppet.deform.checkpoint import read_tensors, write_tensors
from wildpuppet.deform.learn import one_thread
from wildpuppet.machine import Machine
from wildpuppet.tables.autoencoder import SIDE, DeformingAutoEncoder

Picture = UInt8[np.ndarray, "H W 3"]

STEPS = 400
BATCH = 8
RATE = 3e-3
SMOOTH, CENTRED = 1e-3, 0.01
SHARED = 0.5
"""Share of the steps in which all drawings have one texture: the warp must learn to move it first."""
SHIFT = 3
"""Pixels (of 64) by which drawings are shifted in training, at most."""
FINE = 256
"""Side of the grid on which places are looked up in a warp."""
SCHEMA = "wildpuppet.autoencoder/1"


def train_deforming(drawings: list[Picture], seed: int, machine: Machine, steps: int = STEPS) -> DeformingAutoEncoder:
    """Train on drawings of one size."""
    with one_thread():
        known = functional.pad(torch.stack([_square(picture) for picture in drawings]), (SHIFT,) * 4, value=1.0)
        network = DeformingAutoEncoder(torch.Generator().manual_seed(seed))
        optimizer = torch.optim.Adam(network.parameters(), lr=RATE, fused=True)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps)
        for step in range(steps):
            loss = _loss(network, _batch(known, np.random.default_rng([seed, step])), float(step >= SHARED * steps))
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            machine.progress(step + 1, steps)
    return network.eval()


def _batch(known: Float[Tensor, "D 3 P P"], drawn: np.random.Generator) -> Float[Tensor, "B 3 S S"]:
    chosen = drawn.integers(len(known), size=BATCH)
    places = drawn.integers(2 * SHIFT + 1, size=(BATCH, 2))
    return torch.stack(
        [known[i, :, y : y + SIDE, x : x + SIDE] for i, (y, x) in zip(chosen.tolist(), places.tolist(), strict=True)]
    )


def _loss(network: DeformingAutoEncoder, pictures: Float[Tensor, "B 3 S S"], own_texture: float) -> Tensor:
    seen = network(pictures, own_texture)
    wrong = functional.mse_loss(seen.pictures, pictures)
    rough = seen.offsets.diff(dim=2).abs().mean() + seen.offsets.diff(dim=3).abs().mean()
    centred = ((seen.warps.mean(0) - _identity()) ** 2).mean()
    loss: Tensor = wrong + SMOOTH * rough + CENTRED * centred
    return loss


def _identity() -> Float[Tensor, "2 S S"]:
    places = (torch.arange(SIDE) + 0.5) * (2.0 / SIDE) - 1.0
    return torch.stack([places.expand(SIDE, SIDE), places[:, None].expand(SIDE, SIDE)])


@dataclass(frozen=True, eq=False)
class Reading:
    """A drawing as the auto-encoder sees it: the picture again, at the drawing's size, and its warp.

    ``warp`` is x, y in [-1, 1] on a 64 x 64 grid over the drawing's square.
    """

    picture: Picture
    warp: Float32[np.ndarray, "S S 2"]


def read_deforming(network: DeformingAutoEncoder, drawing: Picture) -> Reading:
    """Pass a drawing through the auto-encoder."""
    with one_thread(), torch.no_grad():
        seen = network(_square(drawing)[None])
    small = seen.pictures[0].permute(1, 2, 0).numpy()
    height, width = drawing.shape[:2]
    large = cv2.resize(small, (max(height, width),) * 2, interpolation=cv2.INTER_CUBIC)
    top, left = ((max(height, width) - side) // 2 for side in (height, width))
    picture = np.rint(np.clip(large[top : top + height, left : left + width], 0.0, 1.0) * 255.0).astype(np.uint8)
    return Reading(picture, seen.warps[0].permute(1, 2, 0).numpy())


def carried_by_warps(readings: list[Reading], points: Float[np.ndarray, "A N 2"]) -> Float[np.ndarray, "A A N 2"]:
    """Carry every drawing's points to every drawing: to the place whose texture place is nearest to theirs."""
    height, width = readings[0].picture.shape[:2]
    larger = max(height, width)
    corner = np.array([(larger - width) // 2, (larger - height) // 2], np.float64)
    places = (np.arange(FINE) + 0.5) / FINE * SIDE
    grid = np.stack(np.meshgrid(places, places), -1).reshape(-1, 2)
    trees = [cKDTree(sampled(reading.warp, grid)) for reading in readings]
    carried = np.full((len(readings), *points.shape), np.nan)
    for a, reading in enumerate(readings):
        known = np.isfinite(points[a]).all(-1)
        texture = sampled(reading.warp, (points[a, known] + corner) * (SIDE / larger))
        for b, tree in enumerate(trees):
            carried[a, b, known] = grid[tree.query(texture)[1]] * (larger / SIDE) - corner
        carried[a, a] = points[a]
    return carried


def _square(drawing: Picture) -> Float[Tensor, "3 S S"]:
    """Shrink a drawing into the square, white around it."""
    height, width = drawing.shape[:2]
    larger = max(height, width)
    top, left = (larger - height) // 2, (larger - width) // 2
    padded = cv2.copyMakeBorder(
        drawing, top, larger - height - top, left, larger - width - left, cv2.BORDER_CONSTANT, value=(255, 255, 255)
    )
    small = cv2.resize(padded, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    return torch.from_numpy(small.astype(np.float32) / 255.0).permute(2, 0, 1)


def save_deforming(path: Path, network: DeformingAutoEncoder, identity: str) -> None:
    """Write a trained network, whole or not at all. ``identity`` says what it was trained on."""
    write_tensors(path, network.state_dict(), {"schema": SCHEMA, "identity": identity})


def load_deforming(path: Path, identity: str) -> DeformingAutoEncoder | None:
    """Read a trained network; None where there is none of that identity. Raises StoreError for a damaged file."""
    if not path.is_file():
        return None
    tensors, header = read_tensors(path, "network")
    if header.get("schema") != SCHEMA or header.get("identity") != identity:
        return None
    network = DeformingAutoEncoder(torch.Generator().manual_seed(0))
    network.load_state_dict(tensors)
    return network.eval()
