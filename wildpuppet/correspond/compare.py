"""Methods side by side on a benchmark: one row per set, method and choice of frames, and the means over like sets.

Means are taken over sets, each set weighing the same, as the paper's table does. Drawings whose keypoints have names
were drawn and marked by hand; the others are rendered rigs with exact truth.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from wildpuppet.correspond.pck import Score, Truth, score

Kind = Literal["drawings", "clip"]
Frames = Literal["all", "test"]


class Carried(NamedTuple):
    """Points in every frame; whether they are visible and how far they are to be trusted, if the method says so."""

    points: Float[np.ndarray, "T N 2"]
    visible: Bool[np.ndarray, "T N"] | None = None
    confidence: Float[np.ndarray, "T N"] | None = None


@dataclass(frozen=True)
class Row:
    """How one method did. ``group`` is hand, rigs or clips; ``num_sets`` is how many sets a mean is over."""

    name: str
    group: str
    frames: Frames
    method: str
    score: Score
    num_sets: int | None = None


def compare(name: str, kind: Kind, truth: Truth, carried: Mapping[str, Carried]) -> list[Row]:
    """Score every method on one set: on all frames, and on the frames kept for testing where there are such."""
    group = "clips" if kind == "clip" else "hand" if truth.names else "rigs"
    rows = []
    for method, (points, visible, confidence) in carried.items():
        rows.append(Row(name, group, "all", method, score(truth, points, visible, None, confidence)))
        if truth.test is not None:
            rows.append(Row(name, group, "test", method, score(truth, points, visible, truth.test, confidence)))
    return rows


def means(rows: Sequence[Row]) -> list[Row]:
    """Average over the sets of each group, frames and method, in the order in which they come."""
    groups: dict[tuple[str, Frames, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.group, row.frames, row.method), []).append(row)
    return [
        Row(f"mean of {len(same)} {group}", group, frames, method, _mean([row.score for row in same]), len(same))
        for (group, frames, method), same in groups.items()
    ]


def _mean(scores: Sequence[Score]) -> Score:
    return Score(
        pck=_mean_by_alpha([score.pck for score in scores]) or {},
        median_pixels=round(float(np.mean([score.median_pixels for score in scores])), 2),
        num_points=sum(score.num_points for score in scores),
        hidden=_mean_by_alpha([score.hidden for score in scores]),
        visible_accuracy=_mean_known(score.visible_accuracy for score in scores),
        swaps=_mean_known(score.swaps for score in scores),
        auroc=_mean_known((score.auroc for score in scores), 4),
    )


def _mean_by_alpha(shares: Sequence[dict[float, float] | None]) -> dict[float, float] | None:
    known = [share for share in shares if share is not None]
    if not known:
        return None
    return {alpha: round(float(np.mean([share[alpha] for share in known])), 2) for alpha in known[0]}


def _mean_known(values: Iterable[float | None], digits: int = 2) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.mean(known)), digits) if known else None
