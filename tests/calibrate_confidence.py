"""Weigh the signs of confidence on puppets' own renders: poses drawn with known truth, searched and fitted anew.

    python -m tests.calibrate_confidence [FRAMES]      prints what ``wildpuppet/fit/calibration.py`` holds

Puppets are those of examples/ and drawn figures; no labelled clip or drawing is seen. Each puppet's hinges are set a
little wrong, as guessed ones are. Weights cannot be negative: every sign speaks for a vertex. Beside each set stands
how well weights that were fitted without its puppet find its wrong points (AUROC).
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from tests.figure import DOLL, draw_figure
from tests.own_renders import Kind, OwnRenders, own_renders
from wildpuppet.correspond.pck import WRONG, auroc
from wildpuppet.fit.confidence import signs_of
from wildpuppet.fit.fit import fit
from wildpuppet.fit.signs import NAMES
from wildpuppet.machine import Machine
from wildpuppet.pose.choose import choose
from wildpuppet.pose.hinges import with_hinges
from wildpuppet.pose.search import search
from wildpuppet.pose.tree import joint_points
from wildpuppet.puppet.build import build
from wildpuppet.puppet.folder import read_cutout
from wildpuppet.settings import Settings
from wildpuppet.types import CutOut, Puppet

EXAMPLES = Path(__file__).parents[1] / "examples"
SEEDS = (0, 1)
FRAMES = 10
SLIP = 0.02
"""Standard deviation of the hinges' error, as a share of the puppet's size."""
HIDDEN = 0.25
"""Weight of points anywhere on the drawing, hidden ones among them, beside those that are seen."""
RIDGE = 1e-3


@dataclass(frozen=True, eq=False)
class Sample:
    """Points of one set: their signs (n, K), whether they are right, and weights that sum to 1."""

    puppet: str
    signs: np.ndarray
    is_right: np.ndarray
    weights: np.ndarray
    is_seen: np.ndarray


def cutouts(seed: int) -> Iterator[tuple[str, CutOut]]:
    """Give the puppets: free examples, and figures whose limbs are alike, alike but for a shade, and unlike."""
    for name in ("gbot", "bluto", "bunny"):
        yield name, read_cutout(EXAMPLES / name / "puppet")
    yield "limbs alike", draw_figure(10 + seed, True).cutout
    yield "limbs shaded", shaded(draw_figure(20 + seed, True).cutout, 0.85)
    yield "limbs unlike", draw_figure(30 + seed, False).cutout
    yield "doll shaded", shaded(draw_figure(40 + seed, True, DOLL).cutout, 0.9)
    yield "doll unlike", draw_figure(50 + seed, False, DOLL).cutout


def shaded(cutout: CutOut, light: float) -> CutOut:
    """Darken the left limbs."""
    parts = []
    for part in cutout.parts:
        share = np.array([light] * 3 + [1.0]) if part.name.startswith("left_") else np.ones(4)
        parts.append(replace(part, rgba=(part.rgba * share).astype(np.uint8)))
    return replace(cutout, parts=tuple(parts))


def sample(name: str, cutout: CutOut, kind: Kind, frames: int, hand: np.random.Generator) -> Sample:
    """Draw, search, fit, and compare with the truth."""
    settings, machine = Settings(), Machine(workers=1)
    true = build(cutout, settings.puppet)
    own = own_renders(true, kind, frames, hand)
    size = float(np.ptp(true.vertices, axis=0).max())
    slip = hand.normal(0, SLIP * size, (len(true.joint_layers), 2))
    puppet = with_hinges(true, joint_points(true).mean(1) + slip)
    index = np.arange(frames)
    found = search(puppet, own.crops, own.placement, None, index, settings.search, machine)
    poses = choose(puppet, own.crops, found, settings.search, machine)
    fitted = fit(puppet, own.crops, poses, slice(0, frames), settings.fit, machine)
    signs = np.stack(list(signs_of(puppet, own.crops, found, poses, fitted)))
    corners, weights = _anywhere(puppet, own, hand)
    error = _mixed(fitted.vertices_crop - own.vertices, corners, weights)
    is_right = (np.linalg.norm(error, axis=-1) < WRONG * own.length[:, None]).ravel()
    is_seen = np.repeat(np.arange(corners.shape[1]) < own.corners.shape[1], frames).reshape(-1, frames).T.ravel()
    share = np.where(is_seen, (1 - HIDDEN) / is_seen.sum(), HIDDEN / (~is_seen).sum())
    return Sample(name, _mixed(signs, corners, weights).reshape(-1, len(NAMES)), is_right, share, is_seen)


def _anywhere(puppet: Puppet, own: OwnRenders, hand: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Put as many points on the drawing, seen or not, behind the seen ones: corners and weights (T, 2 N, 3)."""
    a, b, c = (puppet.vertices[puppet.triangles[:, k]] for k in range(3))
    area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    chosen = hand.choice(len(area), own.corners.shape[:2], p=area / area.sum())
    corners, weights = puppet.triangles[chosen], hand.dirichlet((1, 1, 1), own.corners.shape[:2])
    return np.concatenate([own.corners, corners], 1), np.concatenate([own.weights, weights], 1)


def _mixed(values: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    rows = np.arange(len(values))[:, None, None]
    return np.asarray((values[rows, corners] * weights[..., None]).sum(2))


def weighed(samples: list[Sample]) -> np.ndarray:
    """Fit bias and weights: logistic regression, weights not negative, each set counting the same."""
    signs = np.concatenate([one.signs for one in samples]).astype(float)
    sides = np.where(np.concatenate([one.is_right for one in samples]), 1.0, -1.0)
    share = np.concatenate([one.weights for one in samples]) / len(samples)
    middle, spread = signs.mean(0), signs.std(0) + 1e-6
    units = (signs - middle) / spread

    def loss(theta: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sides * (units @ theta[1:] + theta[0])
        slope = -sides * share / (1 + np.exp(margin))
        gradient = np.r_[slope.sum(), units.T @ slope + 2 * RIDGE * theta[1:]]
        return float((share * np.logaddexp(0, -margin)).sum() + RIDGE * (theta[1:] ** 2).sum()), gradient

    bounds = [(None, None)] + [(0, None)] * len(middle)
    theta = minimize(loss, np.zeros(len(middle) + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = theta[1:] / spread
    return np.r_[theta[0] - weights @ middle, weights]


def report(samples: list[Sample]) -> str:
    """Write the table of sets, each judged by weights that never saw its puppet, and the weights of all."""
    lines = []
    for one in samples:
        family = one.puppet.split()[0]
        theta = weighed([other for other in samples if other.puppet.split()[0] != family])
        odds = one.signs[one.is_seen] @ theta[1:] + theta[0]
        right = one.is_right[one.is_seen]
        lines.append(f"# {one.puppet}: right {right.mean():.2f}, AUROC {auroc(~right, odds)}\n")
    theta = weighed(samples)
    lines.append(f"BIAS = {theta[0]:.3f}\nWEIGHTS = {{\n")
    lines += [f'    "{name}": {weight:.2f},\n' for name, weight in zip(NAMES, theta[1:], strict=True)]
    return "".join([*lines, "}\n"])


def main(frames: int) -> None:
    """Make all samples and print the weights."""
    samples = []
    for seed in SEEDS:
        for name, cutout in cutouts(seed):
            for kind in ("drawings", "clip"):
                hand = np.random.default_rng([seed, *name.encode(), *kind.encode()])
                samples.append(sample(name, cutout, kind, frames, hand))
                sys.stderr.write(f"{len(samples)}: {name}, {kind}\n")
    sys.stdout.write(report(samples))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else FRAMES)
