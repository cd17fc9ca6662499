"""The refiner without a network: the puppet's texture taken from the drawings nearest in pose.

At each site (``sites.py``) the colours that the nearest drawings show there are averaged, the rendered puppet among
them as a drawing that is always there:

    colour = (prior * rendered + sum_n w_n c_n) / (prior + sum_n w_n),   w_n = seen_n exp(-d_n^2 / (2 width^2))

with d_n the distance of the poses at that part (``nearness.py``). Where no near drawing has seen the site the rendered
puppet stays. ``outlier`` takes weight from colours far from the others. Beside the puppet the drawings count the less
the farther, and there they must agree, or shreds of each would float around it. The weights are chosen by leaving
drawings out one by one and predicting them from the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import msgspec
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from wildpuppet.machine import Progress, silent
from wildpuppet.refine.examples import Examples
from wildpuppet.refine.figure import Drawn, Figure, scale_of
from wildpuppet.refine.nearness import Nearness
from wildpuppet.refine.sites import Sites, carried, sites_of, visibility
from wildpuppet.types import Puppet

WIDTHS = (0.01, 0.03, 0.06, 0.12, 0.3)
PRIORS = (0.003, 0.03, 0.1, 0.3, 1.0)
OUTLIERS = (0.0, 0.25)
BESIDES = (0.0, 0.25, 0.5, 1.0)
AGREE = 0.1
"""``outlier`` beside the puppet, at most."""
LEFT_OUT = 12
"""Drawings that are predicted from the rest to choose the weights, evenly spread."""
ROUNDS = 2


class Weights(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How drawings are averaged. ``outlier``: distance of colours (0..1) that halves a weight; 0: none loses any.

    ``beside``: how far beyond the puppet they count, as a share of the reach in which they are looked up.
    """

    width: float = 0.06
    prior: float = 0.3
    outlier: float = 0.0
    beside: float = 1.0


class Found(NamedTuple):
    """What the k nearest drawings show at n sites, nearest first; ``away``: the poses' distance at the site's part."""

    sites: Sites
    drawn: Drawn
    colours: Float32[np.ndarray, "k n 4"]
    seen: Bool[np.ndarray, "k n"]
    away: Float[np.ndarray, "k n"]
    reach: float

    @property
    def rendered(self) -> Float32[np.ndarray, "n 4"]:
        """The rendered puppet's colours at the sites."""
        return np.asarray(self.drawn.rgba[self.sites.rows, self.sites.columns])


class Look(NamedTuple):
    """Pictures of one pose: the drawings' average, the nearest drawing's, and how far the average is known (0..1).

    ``spread`` is the drawings' root mean square distance from their average.
    """

    blended: Float32[np.ndarray, "H W 4"]
    nearest: Float32[np.ndarray, "H W 4"]
    known: Float32[np.ndarray, "H W"]
    spread: Float32[np.ndarray, "H W"]


@dataclass(frozen=True)
class Reach:
    """``neighbours``: drawings per part; ``beside``: how far beyond the puppet, as a share of its larger side."""

    neighbours: int = 8
    beside: float = 0.07


class Wardrobe:
    """The drawings, ready to be looked up."""

    def __init__(self, puppet: Puppet, examples: Examples, reach: Reach) -> None:
        self.examples, self._puppet, self._reach = examples, puppet, reach
        self.figure = Figure(puppet, examples.size, scale_of(puppet, examples.vertices))
        self._nearness = Nearness(puppet, examples.vertices)
        poses = zip(examples.vertices, examples.order, strict=True)
        self._seen = [visibility(self.figure.draw(vertices, order).layer) for vertices, order in poses]

    def find(
        self,
        vertices: Float[np.ndarray, "V 2"],
        order: Int[np.ndarray, "L"],
        without: int | None = None,
        size: tuple[int, int] | None = None,
    ) -> Found:
        """Look a pose up, in all drawings but those that show drawing ``without``; ``size`` of the picture made."""
        drawn = self.figure.draw(vertices, order, size)
        reach = self._reach.beside * _side(vertices)
        sites = sites_of(self._puppet, vertices, drawn, reach)
        away = self._nearness.distances(vertices)
        if without is not None:
            away[self.examples.drawing == without] = np.inf
        num_near = min(self._reach.neighbours, len(away))
        nearest = np.argsort(away, axis=0, kind="stable")[:num_near][:, sites.layer]
        distance = np.take_along_axis(away[:, sites.layer], nearest, 0)
        colours = np.zeros((*nearest.shape, 4), np.float32)
        seen = np.zeros(nearest.shape, bool)
        known = self.examples
        for index in np.unique(nearest[np.isfinite(distance)]).tolist():
            rank, site = np.nonzero((nearest == index) & np.isfinite(distance))
            asked = Sites(*(values[site] for values in sites))
            found, shown = carried(asked, known.vertices[index], known.picture(index), self._seen[index])
            colours[rank, site], seen[rank, site] = found, shown
        return Found(sites, drawn, colours, seen, distance, reach)


def _side(vertices: Float[np.ndarray, "V 2"]) -> float:
    return float(np.ptp(vertices, axis=0).max())


def averaged(found: Found, weights: Weights) -> tuple[Float32[np.ndarray, "n 4"], Float32[np.ndarray, "k n"]]:
    """Average the colours at the sites; give the drawings' weights too."""
    rendered, beside = found.rendered, found.sites.beside
    counted = np.where(beside > 0.0, np.clip(1.0 - beside / max(weights.beside * found.reach, 1e-6), 0.0, 1.0), 1.0)
    near = np.exp(-0.5 * (found.away / weights.width) ** 2)
    weight: np.ndarray = (near * found.seen * counted).astype(np.float32)
    prior: np.ndarray = np.full(len(rendered), weights.prior, np.float32)
    result = _mean(found.colours, weight, rendered, prior)
    strict = np.ones(len(rendered), bool) if weights.outlier > 0.0 else beside > 0.0
    tolerance = np.where(beside > 0.0, AGREE, weights.outlier)[strict].astype(np.float32)
    for _ in range(ROUNDS):
        middle, first, own = result[strict], weight[:, strict], prior[strict]
        first = first / (1.0 + _square(found.colours[:, strict], middle) / tolerance**2)
        own = own / (1.0 + _square(rendered[strict], middle) / tolerance**2)
        result[strict] = _mean(found.colours[:, strict], first, rendered[strict], own)
    return result, weight


def _mean(colours: np.ndarray, weight: np.ndarray, rendered: np.ndarray, prior: np.ndarray) -> np.ndarray:
    total = weight.sum(0) + prior
    return np.asarray((np.einsum("knc,kn->nc", colours, weight) + prior[:, None] * rendered) / total[:, None])


def _square(colours: np.ndarray, middle: np.ndarray) -> np.ndarray:
    return np.asarray(((colours - middle) ** 2).sum(-1))


def look_of(found: Found, weights: Weights) -> Look:
    """Make the pictures of a pose."""
    result, weight = averaged(found, weights)
    rendered, total = found.rendered, weight.sum(0)
    first = found.seen.argmax(0)
    nearest = np.take_along_axis(found.colours, first[None, :, None], 0)[0] if len(found.colours) else rendered
    nearest = np.where(np.asarray(found.seen.any(0))[:, None], nearest, rendered)
    spread = np.sqrt((_square(found.colours, result) * weight).sum(0) / np.maximum(total, 1e-6))
    rows, columns = found.sites.rows, found.sites.columns
    look = Look(
        found.drawn.rgba.copy(),
        found.drawn.rgba.copy(),
        np.zeros(found.drawn.layer.shape, np.float32),
        np.zeros(found.drawn.layer.shape, np.float32),
    )
    look.blended[rows, columns], look.nearest[rows, columns] = result, nearest
    look.known[rows, columns] = total / (total + weights.prior)
    look.spread[rows, columns] = spread
    return look


def choose_weights(
    wardrobe: Wardrobe, among: Sequence[int] | None = None, progress: Progress = silent
) -> tuple[Weights, float]:
    """Choose the weights that predict left-out drawings best; give their mean squared error over white (0..255).

    ``among`` are the drawings that may be left out. The usual mistake: drawings that show the same twice under
    different ``drawing`` numbers make near drawings look better than they are.
    """
    examples = wardrobe.examples
    possible = np.arange(len(examples)) if among is None else np.array(among)
    chosen = possible[np.linspace(0, len(possible) - 1, min(LEFT_OUT, len(possible))).round().astype(int)]
    cases = []
    for done, index in enumerate(chosen.tolist()):
        found = wardrobe.find(examples.vertices[index], examples.order[index], int(examples.drawing[index]))
        cases.append((found, examples.picture(index)))
        progress(done + 1, len(chosen))
    best, error = _best(cases, [Weights(width, prior) for width, prior in product(WIDTHS, PRIORS)])
    for name, values in (("beside", BESIDES), ("outlier", OUTLIERS)):
        best, error = _best(cases, [msgspec.structs.replace(best, **{name: value}) for value in values])
    return best, error


def _best(cases: Sequence[tuple[Found, np.ndarray]], tried: Sequence[Weights]) -> tuple[Weights, float]:
    """Find the weights with the least mean error."""
    errors = [float(np.mean([_error(found, truth, weights) for found, truth in cases])) for weights in tried]
    best = int(np.argmin(errors))
    return tried[best], errors[best]


def _error(found: Found, truth: Float32[np.ndarray, "H W 4"], weights: Weights) -> float:
    """Compare over white at the sites; what lies beyond them is the same for all weights."""
    sites = found.sites
    result, _ = averaged(found, weights)
    rest = ((on_white(found.drawn.rgba) - on_white(truth)) ** 2).sum()
    wanted = on_white(truth[sites.rows, sites.columns])
    before = ((on_white(found.rendered) - wanted) ** 2).sum()
    after = ((on_white(result) - wanted) ** 2).sum()
    return float(255.0**2 * (rest - before + after) / truth[..., :3].size)


def on_white(premultiplied: Float32[np.ndarray, "*shape 4"]) -> Float32[np.ndarray, "*shape 3"]:
    """Lay a premultiplied picture over white."""
    return np.asarray(premultiplied[..., :3] + (1.0 - premultiplied[..., 3:]))
