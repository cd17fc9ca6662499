"""A curve between two keys that knows the keys around them, and how much to trust those.

Between keys b and c, at times t_b and t_c, with a before and d after, the curve is the chord plus ``strength`` times a
bulge. With strength 1 it is the cubic Hermite curve whose tangent at a key is that of the parabola through the key and
its two neighbours (Bessel's; any spacing). With strength 0 it is the chord. Where only one of a and d is known, the
bulge makes it the parabola through three keys; where neither is, there is no bulge. It always passes through b and c.

How strong the bulge ought to be depends on the motion and on how finely it was drawn: ``fitted_strength`` learns it
from drawings whose neighbours are known, as the share of the bulge that they really have.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

MOST_STRENGTH = 1.25
"""Motion drawn coarsely wants more than the cubic; beyond this the curve swings out."""
ROUNDS = 5
FLOOR = 0.3
"""Cases that err by less than this share of the middle error weigh no more than one that errs by it."""


class Times(NamedTuple):
    """When the keys are: before, the two keys and after; NaN where there is no such key."""

    before: float
    first: float
    last: float
    after: float


def chord(
    first: Float[np.ndarray, "*channels"], last: Float[np.ndarray, "*channels"], share: float
) -> Float[np.ndarray, "*channels"]:
    """Go straight: ``share`` is 0 at the first key and 1 at the last."""
    return (1.0 - share) * first + share * last


def bulge(
    keys: tuple[
        Float[np.ndarray, "*channels"],
        Float[np.ndarray, "*channels"],
        Float[np.ndarray, "*channels"],
        Float[np.ndarray, "*channels"],
    ],
    times: Times,
    share: float,
) -> Float[np.ndarray, "*channels"]:
    """Give what the curve adds to the chord at ``share`` of the way; a missing key's values do not count."""
    before, first, last, after = keys
    span = times.last - times.first
    slope = (last - first) / span
    has_before, has_after = bool(np.isfinite(times.before)), bool(np.isfinite(times.after))
    enter, leave = np.zeros_like(slope), np.zeros_like(slope)
    if has_before:
        step = times.first - times.before
        enter = (span * (first - before) / step + step * slope) / (span + step) - slope
    if has_after:
        step = times.after - times.last
        leave = (span * (after - last) / step + step * slope) / (span + step) - slope
    if not has_after:
        leave = -enter
    elif not has_before:
        enter = -leave
    early, late = share * (1.0 - share) ** 2, -(share**2) * (1.0 - share)
    return np.asarray(span * (early * enter + late * leave))


def fitted_strength(
    missed: Float[np.ndarray, "n C"], bulges: Float[np.ndarray, "n C"], prior: float, prior_cases: float = 4.0
) -> float:
    """Find the strength with which n known drawings lie nearest to the curve between their neighbours.

    ``missed`` is what the chord misses of each drawing, ``bulges`` the curve's bulge there. Robust least squares: a
    case counts by the inverse of its error, so that one wrong fit does not decide. ``prior`` counts as
    ``prior_cases`` average cases, and decides alone where there are none or nothing moves.
    """
    if not len(missed):
        return prior
    along, size = (missed * bulges).sum(1), (bulges**2).sum(1)
    if not size.any():
        return prior
    weights, strength = np.ones(len(along)), prior
    for _ in range(ROUNDS):
        hold = prior_cases * float((weights * size).sum()) / len(along)
        strength = float(((weights * along).sum() + hold * prior) / ((weights * size).sum() + hold))
        error = np.sqrt(((missed - strength * bulges) ** 2).sum(1))
        middle = float(np.median(error))
        weights = 1.0 / np.maximum(error, max(FLOOR * middle, 1e-9))
    return float(np.clip(strength, 0.0, MOST_STRENGTH))
