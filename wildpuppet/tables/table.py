"""From scores to tables: mean over seeds, mean over sets, and how far seeds lie apart.

A score is one number of one method on one set with one seed. Every set weighs the same. The spread of a mean over sets
is taken over the seeds' own means, not over the sets: it says how sure the method's number is. Of a method that failed
on some sets the mean is over the others and says over how many.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

MEAN = "mean"


@dataclass(frozen=True)
class Score:
    """``value`` of ``measure`` (mse, pck .1, ...) for a method on a set. ``seed`` is 0 where nothing is random."""

    name: str
    method: str
    seed: int
    measure: str
    value: float


@dataclass(frozen=True)
class Cell:
    """A mean over seeds and their standard deviation (None with one seed); ``num_sets`` of a mean over sets."""

    value: float
    spread: float | None = None
    num_sets: int | None = None


def cell(scores: Sequence[Score], method: str, measure: str, name: str) -> Cell | None:
    """Give one cell, or the method's mean over sets where ``name`` is MEAN; None where there is nothing."""
    mine = [score for score in scores if (score.method, score.measure) == (method, measure)]
    mine = [score for score in mine if np.isfinite(score.value) and name in (MEAN, score.name)]
    names = in_order(score.name for score in mine)
    if not names:
        return None
    by_name = [{score.seed: score.value for score in mine if score.name == known} for known in names]
    seeds = sorted(set.union(*map(set, by_name)))
    by_seed = [np.mean([_of_seed(values, seed) for values in by_name]) for seed in seeds]
    spread = float(np.std(by_seed, ddof=1)) if len(seeds) > 1 else None
    return Cell(float(np.mean(by_seed)), spread, len(names) if name == MEAN else None)


def _of_seed(values: dict[int, float], seed: int) -> float:
    """Take a seed's value, or the mean of those there are: not every set needs to have all seeds yet."""
    return values.get(seed, float(np.mean(list(values.values()))))


def in_order(items: Iterable[str]) -> list[str]:
    """Give each of the items once, in the order in which they come."""
    return list(dict.fromkeys(items))


def markdown(
    scores: Sequence[Score], measures: Sequence[str], digits: int = 1, show: Callable[[float], float] | None = None
) -> str:
    """Write methods down and sets across, the mean last; several measures stand in one cell with strokes between."""
    names = in_order(score.name for score in scores)
    known = [score for score in scores if score.measure in measures]
    rows = [["method", *names, MEAN], ["---", *["---:"] * (len(names) + 1)]]
    for method in in_order(score.method for score in known):
        found = [[cell(known, method, measure, name) for measure in measures] for name in (*names, MEAN)]
        rows.append([method, *(_shown(cells, len(names), digits, show) for cells in found)])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _shown(cells: Sequence[Cell | None], num_sets: int, digits: int, show: Callable[[float], float] | None) -> str:
    known = [each for each in cells if each is not None]
    if not known:
        return "-"
    text = " / ".join(f"{each.value if show is None else show(each.value):.{digits}f}" for each in known)
    if len(known) == 1 and known[0].spread is not None and show is None:
        text += f" ± {known[0].spread:.{digits}f}"
    elif known[0].spread is not None and show is None:
        text += f" (± {max(each.spread or 0.0 for each in known):.{digits}f})"
    partial = known[0].num_sets
    return text if partial in (None, num_sets) else f"{text} ({partial} of {num_sets})"
