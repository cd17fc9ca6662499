"""Which drawings of a run follow one another: what may stand beside a pose as the one before or after it.

A held drawing counts once, at the frame where it begins. A passage is a stretch of drawings that are one motion. It
ends at a cut, where the character is lost, and where the puppet jumps: between two drawings that lie farther apart than
``JUMP`` times the middle of the four steps around (two on each side), as where a folder goes from one animation to the
next. In a folder without any order no step is larger than those around it and all of it is one passage; the curves
then learn from it that its neighbours say nothing (``curves.fitted_strength``).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.geometry.affine import apply
from wildpuppet.types import Crops, Fit

JUMP = 3.0
"""How many times the steps around it a step must be to end a passage; 2 ends it in fast starts, 5 joins animations."""
STILL_SHARE = 1e-3
"""Steps below this share of the puppet's size are taken for stillness: noise in a hold is no motion to compare with."""
STEPS_AROUND = 2


@dataclass(frozen=True, eq=False)
class Drawings:
    """The usable drawings of a run, in order of time.

    ``rows`` index the run's frames, ``times`` are frame numbers, ``passage`` numbers the passages, ``vertices`` are
    video pixels. ``is_ordered`` is False for a folder of drawings, whose order may mean nothing.
    """

    rows: Int[np.ndarray, "D"]
    times: Float[np.ndarray, "D"]
    passage: Int[np.ndarray, "D"]
    vertices: Float[np.ndarray, "D V 2"]
    order: Int[np.ndarray, "D L"]
    is_ordered: bool

    def __len__(self) -> int:
        return len(self.rows)


def drawings_of(crops: Crops, fit: Fit, keys: tuple[int, ...] = ()) -> Drawings:
    """List the drawings that were found and not doubted.

    Frames ``keys`` are listed even where they are doubted, and stand for their drawing at their own place and time.
    """
    vertices = apply(crops.video_from_crop, fit.vertices_crop.astype(np.float64))
    exposure = np.cumsum(np.concatenate([[0], np.diff(crops.drawing) != 0]))
    is_key = np.isin(fit.frames, keys)
    is_new = np.concatenate([[True], np.diff(exposure) != 0]) & ~np.isin(exposure, exposure[is_key])
    is_found = np.array([state in ("fitted", "held") for state in fit.state]) & np.isfinite(vertices).all((1, 2))
    is_lost = np.array([state == "lost" for state in fit.state])
    rows = np.flatnonzero((is_new & is_found) | is_key)
    broken = np.cumsum(is_lost) + np.cumsum(np.concatenate([[0], np.diff(crops.shot) != 0]))
    passage = passages(vertices[rows], broken[rows])
    times = fit.frames[rows].astype(np.float64)
    return Drawings(rows, times, passage, vertices[rows], fit.order[rows].astype(np.int64), crops.ordered)


def passages(vertices: Float[np.ndarray, "D V 2"], scenes: Int[np.ndarray, "D"]) -> Int[np.ndarray, "D"]:
    """Number the passages; drawings of two scenes are never in one."""
    if not len(vertices):
        return np.zeros(0, np.int64)
    steps = np.linalg.norm(np.diff(vertices, axis=0), axis=-1).mean(1)
    still = STILL_SHARE * float(np.ptp(vertices, axis=1).max())
    is_cut = np.diff(scenes) != 0
    ends = np.array([is_cut[k] or _is_jump(steps, is_cut, k, still) for k in range(len(steps))], bool)
    return np.concatenate([[0], np.cumsum(ends)]).astype(np.int64)


def _is_jump(steps: Float[np.ndarray, "S"], is_cut: np.ndarray, k: int, still: float) -> bool:
    around = [j for j in range(k - STEPS_AROUND, k + STEPS_AROUND + 1) if j != k and 0 <= j < len(steps)]
    usual = [float(steps[j]) for j in around if not is_cut[j]]
    return bool(usual) and float(steps[k]) > JUMP * max(float(np.median(usual)), still)
