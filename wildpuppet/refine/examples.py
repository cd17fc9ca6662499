"""The drawings that a refiner learns from: what each shows, and where the puppet is in it.

Pictures are premultiplied, so that what lies beside the character is nothing (0) and pictures can be mixed. Drawings
have a matte of their own. The matte of a clip's frame says how surely the character is seen, not how much it covers:
the rendered puppet's alpha stands for it except where the matte is sure of something else, and nothing counts far from
the puppet.
"""

from collections.abc import Collection
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from wildpuppet.errors import InputError
from wildpuppet.refine.figure import Drawn, Figure, scale_of
from wildpuppet.types import Crops, Fit, FitState, Puppet

MOST_EXAMPLES = 240
"""Drawings at most, evenly spread over those there are; bounds the memory (0.5 MB each)."""
LEAST_EXAMPLES = 2
FEW = 6
"""With fewer trusted drawings, doubtful ones are learnt from too."""
UNKNOWN = 128
SURELY_NOT, SURELY = (0.05, 0.2), (0.88, 1.0)
"""Values of a clip's matte between which a pixel turns from surely not the character, and to surely it."""
NEAR_SHARE = 0.08
"""Where the matte of a clip counts: so far beyond the puppet, as a share of its larger side."""


@dataclass(frozen=True, eq=False)
class Examples:
    """N drawings in crop pixels; ``rgba`` premultiplied; those with the same ``drawing`` show the same one."""

    frames: Int[np.ndarray, "N"]
    drawing: Int[np.ndarray, "N"]
    rgba: UInt8[np.ndarray, "N H W 4"]
    vertices: Float[np.ndarray, "N V 2"]
    order: Int[np.ndarray, "N L"]

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) of the pictures."""
        return self.rgba.shape[2], self.rgba.shape[1]

    def picture(self, index: int) -> Float32[np.ndarray, "H W 4"]:
        """Give one drawing, premultiplied, 0..1."""
        return np.asarray(self.rgba[index].astype(np.float32) / 255.0)


def usable_frames(crops: Crops, fit: Fit, hold_out: Collection[int] = ()) -> Int[np.ndarray, "n"]:
    """List the indices of frames to learn from: each drawing once, fitted, none whose drawing is held out.

    Where that leaves few, doubtful frames are taken too. ``hold_out`` are frame numbers. Raises InputError for numbers
    that are not the run's and where too few are left.
    """
    unknown = sorted(set(hold_out) - set(fit.frames.tolist()))
    if unknown:
        first, last = int(fit.frames[0]), int(fit.frames[-1])
        raise InputError(f"--hold-out {unknown[0]}: expected frames of the run, {first} to {last}")
    held_out = set(crops.drawing[np.isin(fit.frames, list(hold_out))].tolist())
    usable = _distinct(crops, fit, held_out, {"fitted"})
    if len(usable) < FEW:
        usable = _distinct(crops, fit, held_out, {"fitted", "doubtful"})
    if len(usable) < LEAST_EXAMPLES:
        raise InputError(
            f"expected at least {LEAST_EXAMPLES} different drawings to learn from, found {len(usable)}; "
            "hold fewer frames out, or run on more"
        )
    chosen = np.linspace(0, len(usable) - 1, min(len(usable), MOST_EXAMPLES)).round().astype(int)
    return np.asarray(np.array(usable, np.int64)[chosen])


def _distinct(crops: Crops, fit: Fit, held_out: set[int], states: set[FitState]) -> list[int]:
    """List the first frame in one of ``states`` of each drawing."""
    known, found = set(held_out), []
    for index, (state, drawing) in enumerate(zip(fit.state, crops.drawing.tolist(), strict=True)):
        if state in states and drawing not in known and np.isfinite(fit.vertices_crop[index]).all():
            known.add(drawing)
            found.append(index)
    return found


def examples_of(puppet: Puppet, crops: Crops, fit: Fit, chosen: Int[np.ndarray, "n"]) -> Examples:
    """Read the pictures of the frames with indices ``chosen``, rising."""
    vertices = fit.vertices_crop[chosen].astype(np.float64)
    figure = Figure(puppet, crops.size, scale_of(puppet, vertices))
    pictures = []
    for index, placed in zip(chosen.tolist(), vertices, strict=True):
        image = np.asarray(crops.images[index : index + 1][0])
        drawn = None if not crops.ordered else figure.draw(placed, fit.order[index])
        pictures.append(premultiplied(image, drawn))
    return Examples(fit.frames[chosen], crops.drawing[chosen], np.stack(pictures), vertices, fit.order[chosen])


def premultiplied(image: UInt8[np.ndarray, "H W 4"], drawn: Drawn | None = None) -> UInt8[np.ndarray, "H W 4"]:
    """Multiply colour by alpha. With the rendered puppet ``drawn``, alpha is a clip's matte: see the module's head."""
    alpha = image[..., 3].astype(np.float32) / 255.0
    if drawn is not None:
        alpha = _alpha_of_clip(image[..., 3], drawn)
    colour = image[..., :3].astype(np.float32) * alpha[..., None]
    return np.asarray(np.rint(np.dstack([colour, 255.0 * alpha])), np.uint8)


def _alpha_of_clip(matte: UInt8[np.ndarray, "H W"], drawn: Drawn) -> Float32[np.ndarray, "H W"]:
    covered = drawn.rgba[..., 3]
    if not (covered > 0.0).any():
        return np.zeros_like(covered)
    rows, columns = np.nonzero(covered > 0.0)
    reach = NEAR_SHARE * max(int(np.ptp(rows)), int(np.ptp(columns)), 1)
    away = cv2.distanceTransform((covered == 0.0).astype(np.uint8), cv2.DIST_L2, 5)
    share = matte.astype(np.float32) / 255.0
    decided = np.maximum(covered * _ramp(share, *SURELY_NOT), _ramp(share, *SURELY))
    known = np.where(matte == UNKNOWN, covered, decided)
    return np.asarray(np.where(away <= reach, known, 0.0), np.float32)


def _ramp(values: Float32[np.ndarray, "H W"], low: float, high: float) -> Float32[np.ndarray, "H W"]:
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0), np.float32)
