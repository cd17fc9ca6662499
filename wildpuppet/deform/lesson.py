"""What our recipe learns from, made once before the first step: the skeleton with its bends, the code, the pictures.

The code is principal components of the fitted poses, whitened (probabilistic PCA: what the fits never do still has a
small variance): its first numbers move the puppet as the fits do, the last ones every part alone.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from wildpuppet.deform.model import LEAST_TRUST, over_white
from wildpuppet.deform.poses import Known, Studio, known_poses
from wildpuppet.deform.skeleton import (
    Code,
    Skeleton,
    SkeletonTensors,
    poses_of,
    skeleton_of,
    vertices_of,
    with_bends,
)
from wildpuppet.errors import InputError
from wildpuppet.fit.energy import to_unit
from wildpuppet.render.render import mesh_of, render, texture_at
from wildpuppet.types import Crops, Fit, Puppet

BENDS = 2
"""Bends of each part that are taken from the fits."""
FREE = 0.25
"""Standard deviation of what the fits never do, as a share of that of made-up poses. Less ties limbs together more:
dragging one then moves the others as they moved in the fits (measured: 0.25 and 0.1 alike, 1 worse by a sixth)."""
LEAST_FRAMES = 4
MOST_BACKGROUNDS = 24
FINER = 2
"""Real pictures are kept so much larger than the encoder sees them, so that moving them does not blur them."""
WHITE = 255


@dataclass(frozen=True, eq=False)
class Lesson:
    """Everything a step draws its batch from. Vertices in unit coordinates; ``window`` is the crop's (w, h), small.

    ``real[n]`` is a picture ``FINER`` times as large as the window, ``truth[n]`` what the fit says of it and
    ``trust[n]`` how surely.
    """

    skeleton: Skeleton
    known: Known
    studio: Studio
    code: Code
    real: UInt8[np.ndarray, "N h2 w2 3"]
    truth: Float[np.ndarray, "N V 2"]
    trust: Float[np.ndarray, "N V"]
    size: tuple[int, int]
    pixels: int

    @property
    def window(self) -> tuple[int, int]:
        """(w, h) of the crop as the encoder sees it, without the square's black rest."""
        return self.studio.size


def taught_frames(crops: Crops, fit: Fit, hold_out: Int[np.ndarray, "n"]) -> Int[np.ndarray, "D"]:
    """Choose the frames to learn from, each drawing once, none that a held-out frame shows.

    Doubtful fits count (by their confidence) only where fewer than ``LEAST_FRAMES`` are better.
    """
    is_out = np.isin(crops.drawing, crops.drawing[np.isin(crops.frames, hold_out)])
    is_whole = np.isfinite(fit.vertices_crop).all((1, 2)) & ~is_out
    for states in (("fitted",), ("fitted", "doubtful")):
        rows = np.flatnonzero(is_whole & np.isin(fit.state, states))
        _, first = np.unique(crops.drawing[rows], return_index=True)
        if len(first) >= LEAST_FRAMES:
            break
    return np.sort(rows[first])


def lesson_of(puppet: Puppet, crops: Crops, fit: Fit, rows: Int[np.ndarray, "D"], code: int, pixels: int) -> Lesson:
    """Prepare the lesson from the frames ``rows``; raises InputError where there are none."""
    if not len(rows):
        raise InputError("expected fitted frames to learn from, found none: hold out fewer, or look at the run's sheet")
    truth = to_unit(torch.from_numpy(fit.vertices_crop[rows]), crops.size).numpy()
    trust = np.maximum(fit.confidence[rows], LEAST_TRUST)
    skeleton = with_bends(skeleton_of(puppet), truth, trust, BENDS)
    known = known_poses(skeleton, poses_of(skeleton, truth, trust), fit.order[rows])
    window = window_of(crops.size, pixels)
    pictures = real_pictures(crops, rows, window)
    studio = studio_of(puppet, crops, fit, rows, pictures, window)
    return Lesson(skeleton, known, studio, code_of(skeleton, known, code), pictures, truth, trust, crops.size, pixels)


def window_of(size: tuple[int, int], pixels: int) -> tuple[int, int]:
    """Give the size of a crop within the encoder's square, as ``network.shrink`` lays it."""
    scale = pixels / max(size)
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def code_of(skeleton: Skeleton, known: Known, code: int) -> Code:
    """Find the code's directions: the main ones of the fits, measured by how far they move vertices."""
    mean = known.poses.mean(0)
    reach = _reach(skeleton, mean)
    left = (known.poses - mean) * reach
    values, axes = np.linalg.eigh(left.T @ left / len(left) + np.diag((FREE * reach * known.spread) ** 2))
    chosen = np.argsort(values)[::-1][: min(code, skeleton.num_numbers)]
    spread, main = np.sqrt(values[chosen]), axes[:, chosen]
    main = main * np.sign(main[np.abs(main).argmax(0), np.arange(len(chosen))])
    return Code(mean, (main * spread).T / reach, reach[:, None] * main / spread)


def _reach(skeleton: Skeleton, pose: Float[np.ndarray, "P"]) -> Float[np.ndarray, "P"]:
    """How far (root mean square) the vertices move for a small change of each number."""
    small = 1e-2
    tensors = SkeletonTensors(skeleton)
    changed = torch.from_numpy(np.concatenate([pose[None], pose + small * np.eye(len(pose))])).float()
    with torch.no_grad():
        placed = vertices_of(tensors, changed).numpy()
    return np.asarray(np.sqrt(((placed[1:] - placed[0]) ** 2).sum(-1).mean(-1)) / small + 1e-6, np.float64)


def real_pictures(crops: Crops, rows: Int[np.ndarray, "D"], window: tuple[int, int]) -> UInt8[np.ndarray, "D h2 w2 3"]:
    """Read the frames, small; drawings over white."""
    pictures = []
    for row in rows:
        image = crops.images[int(row) : int(row) + 1]
        rgb = image[..., :3] if crops.ordered else over_white(image)
        pictures.append(cv2.resize(rgb[0], (FINER * window[0], FINER * window[1]), interpolation=cv2.INTER_AREA))
    return np.stack(pictures)


def studio_of(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    rows: Int[np.ndarray, "D"],
    pictures: UInt8[np.ndarray, "D h2 w2 3"],
    window: tuple[int, int],
) -> Studio:
    """Prepare the mesh, the texture at the size at which it is seen, and the backgrounds."""
    size = np.ptp(fit.vertices_crop[rows], axis=1).max(1) / np.ptp(puppet.vertices, axis=0).max()
    scale = float(np.median(size)) * window[0] / crops.size[0]
    mesh, texture = mesh_of(puppet), texture_at(puppet, scale)
    if not crops.ordered:
        return Studio(mesh, texture, np.full((1, window[1], window[0], 3), WHITE, np.uint8), True)
    chosen = np.unique(np.linspace(0, len(rows) - 1, MOST_BACKGROUNDS).round().astype(int))
    factor = np.array([window[0] / crops.size[0], window[1] / crops.size[1]])
    vertices = torch.from_numpy(fit.vertices_crop[rows[chosen]] * factor).float()
    orders = torch.from_numpy(np.array(fit.order[rows[chosen]])).long()
    with torch.no_grad():
        alpha = render(vertices, mesh, texture, orders, window).rgba[..., 3].numpy()
    behind = [
        _without(cv2.resize(pictures[n], window, interpolation=cv2.INTER_AREA), mask)
        for n, mask in zip(chosen, alpha, strict=True)
    ]
    return Studio(mesh, texture, np.stack(behind), False)


def _without(picture: UInt8[np.ndarray, "h w 3"], alpha: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Paint the character over with what is around it."""
    mask = cv2.dilate((alpha > 0.05).astype(np.uint8), np.ones((5, 5), np.uint8))
    return np.asarray(cv2.inpaint(picture, mask, 3, cv2.INPAINT_TELEA))
