"""Percentage of correct keypoints: how well carried points agree with the truth.

The paper's protocol: a point is right at alpha when its error is below alpha * L. L is the larger side of the image for
drawings and the larger side of the character's own box for clips, which is stricter. A point counts where it is
visible both in the reference frame and in the frame at hand; the reference frame itself does not count. Hidden points
(visible in the reference, covered in the frame, their place known) are scored apart, and so are left/right swaps:
keypoints farther than .1 L from their own place and nearer than .05 L to their mirror twin's.

Confidence is judged by how well it tells the wrong points (at .05) from the right ones, ``auroc``.
"""

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import rankdata

from wildpuppet.errors import InputError

ALPHAS = (0.1, 0.05, 0.025, 0.0125)
WRONG = 0.05
"""Alpha at which confidence is judged."""
SWAPPED_AWAY, SWAPPED_ONTO = 0.1, 0.05

LEAST_HIDDEN = 21
"""With fewer hidden points than this their share says nothing and is left out."""


@dataclass(frozen=True, eq=False)
class Truth:
    """A benchmark's ground truth. ``length`` is L per frame; ``test`` the frames kept for testing, if any.

    ``part`` indexes the puppet's parts; ``names`` the keypoints' names, if they have any (drawn by hand).
    """

    points: Float[np.ndarray, "T N 2"]
    visible: Bool[np.ndarray, "T N"]
    part: Int[np.ndarray, "N"]
    reference: int
    length: Float[np.ndarray, "T"]
    boxes: Float[np.ndarray, "T 4"] | None = None
    test: Int[np.ndarray, "n"] | None = None
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Score:
    """Percentages; ``pck`` and ``hidden`` map alpha to the share of right points. None: nothing to count.

    ``auroc`` (0..1) is how well confidence finds the points that are wrong at .05.
    """

    pck: dict[float, float]
    median_pixels: float
    num_points: int
    hidden: dict[float, float] | None = None
    visible_accuracy: float | None = None
    swaps: float | None = None
    auroc: float | None = None


def read_truth(path: Path) -> Truth:
    """Read a ground-truth npz; raises InputError where it lacks what scoring needs."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        points = arrays["points"]
        boxes = arrays.get("boxes")
        larger = np.full(len(points), float(arrays["canvas"].max())) if boxes is None else boxes[:, 2:].max(1)
        return Truth(
            points, arrays["visible"], arrays["part"], int(arrays["reference"]), larger, boxes,
            arrays.get("test"), tuple(str(name) for name in arrays.get("names", ())),
        )  # fmt: skip
    except (OSError, EOFError, KeyError, ValueError, BadZipFile) as error:
        raise InputError(
            f"{path}: expected ground truth (npz with points, visible, part, reference); {error}"
        ) from None


def score(
    truth: Truth,
    points: Float[np.ndarray, "T N 2"],
    visible: Bool[np.ndarray, "T N"] | None = None,
    frames: Int[np.ndarray, "n"] | None = None,
    confidence: Float[np.ndarray, "T N"] | None = None,
) -> Score:
    """Score carried points against the truth, in the given frames or in all. Points that are not finite are wrong."""
    if points.shape != truth.points.shape:
        raise ValueError(f"expected points of shape {truth.points.shape}, found {points.shape}")
    kept = np.ones(len(points), bool) if frames is None else np.isin(np.arange(len(points)), frames)
    kept[truth.reference] = False
    started = truth.visible[truth.reference] & kept[:, None]
    counted = truth.visible & started
    hidden = ~truth.visible & started & np.isfinite(truth.points).all(-1)
    error, length = _error(truth, points), truth.length[:, None]
    many_hidden = int(hidden.sum()) >= LEAST_HIDDEN
    both = counted | hidden
    return Score(
        pck={alpha: _percent((error < alpha * length)[counted]) for alpha in ALPHAS},
        median_pixels=float(np.median(error[counted])) if counted.any() else float("nan"),
        num_points=int(counted.sum()),
        hidden={alpha: _percent((error < alpha * length)[hidden]) for alpha in ALPHAS[:2]} if many_hidden else None,
        visible_accuracy=_percent((visible == truth.visible)[both]) if many_hidden and visible is not None else None,
        swaps=_swaps(truth, points, counted),
        auroc=None if confidence is None else auroc((error >= WRONG * length)[counted], confidence[counted]),
    )


def auroc(wrong: Bool[np.ndarray, "n"], confidence: Float[np.ndarray, "n"]) -> float | None:
    """Compute how often a wrong point is trusted less than a right one, ties by half: 1 is perfect, .5 is chance.

    This is the area under the ROC curve of low confidence as a sign of error. None where all are right or all wrong.
    """
    num_wrong, num_right = int(wrong.sum()), int((~wrong).sum())
    if not num_wrong or not num_right:
        return None
    ranks = rankdata(-confidence.astype(np.float64))  # ties share their mean rank
    above = float(ranks[wrong].sum()) - num_wrong * (num_wrong + 1) / 2
    return round(above / (num_wrong * num_right), 4)


def _error(truth: Truth, points: Float[np.ndarray, "T N 2"]) -> Float[np.ndarray, "T N"]:
    distance = np.linalg.norm(points.astype(np.float64) - truth.points, axis=-1)
    return np.where(np.isfinite(distance), distance, np.inf)


def _percent(right: Bool[np.ndarray, "n"]) -> float:
    return round(100 * float(right.mean()), 2) if right.size else float("nan")


def mirror_twins(names: tuple[str, ...]) -> Int[np.ndarray, "N"]:
    """Index of each keypoint's twin on the other side (Left- and Right- in its name), -1 where it has none."""
    number = {name: index for index, name in reversed(tuple(enumerate(names)))}
    twins = [name.replace("Left", "#").replace("Right", "Left").replace("#", "Right") for name in names]
    pairs = zip(names, twins, strict=True)
    return np.array([number.get(twin, -1) if twin != name else -1 for name, twin in pairs], np.int64)


def _swaps(truth: Truth, points: Float[np.ndarray, "T N 2"], counted: Bool[np.ndarray, "T N"]) -> float | None:
    twins = mirror_twins(truth.names)
    sided = np.flatnonzero(twins >= 0)
    if not len(sided):
        return None
    allowed = truth.length[:, None]
    points = points.astype(np.float64)
    own = np.linalg.norm(points[:, sided] - truth.points[:, sided], axis=-1)
    other = np.linalg.norm(points[:, sided] - truth.points[:, twins[sided]], axis=-1)
    swapped = (own > SWAPPED_AWAY * allowed) & (other < SWAPPED_ONTO * allowed) & counted[:, sided]
    return round(100 * float(swapped.sum() / max(1, counted[:, sided].sum())), 2)
