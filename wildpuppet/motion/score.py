"""Leave a drawing out and predict it from its neighbours: how good inbetweens are, next to the baselines.

    run = open_run("out/fox")                            # a finished run
    truth = read_truth(Path("bench/fox/gt.npz"))         # optional
    source = source_of(Path("bench/fox/frames"))         # optional: pictures for the line distance
    scores = leave_one_out(run.puppet, run.crops, run.fit, truth, source.picture)
    scores.table()                                       # method -> mean of each measure
    scores.ratio("ours", "vertices")                     # against the better of linear and arap

A drawing is predicted from the drawing before and the one after (and, for ``ours``, those beyond), if all are of one
passage (``passages``); nothing that is learnt for it has seen it. Places where the neighbours belong to another motion
are skipped and counted. Three truths, kept apart:

- ``vertices``: mean distance of the mesh from the left-out drawing's own fit, video pixels;
- ``points``: mean distance of the truth's points that are seen there and in the reference;
- ``true_points``: the same where the neighbours, too, are posed by the truth's points instead of by the fit
  (``posed_by_points``): what interpolation alone loses;
- ``lines``: Chamfer distance between the lines of the rendered prediction and those of the drawing (of the rendered
  fit, where no pictures are given).

A fit's own errors are in ``vertices`` and ``points`` of every method alike: ``fit_points`` is what the left-out
drawing's own fit scores there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.correspond.locate import Anchors, locate
from wildpuppet.correspond.pck import Truth
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import Progress, silent
from wildpuppet.motion.bones import BoneTree, bone_tree_of
from wildpuppet.motion.draw_order import orders_between
from wildpuppet.motion.inbetween import Codes, Method, between, keys_of, strengths_of, with_winding
from wildpuppet.motion.lines import chamfer, drawn_on_white, lines_of
from wildpuppet.motion.passages import Drawings, drawings_of, passages
from wildpuppet.motion.through_points import posed_by_points
from wildpuppet.render.render import mesh_of, texture_at
from wildpuppet.types import Crops, Fit, Puppet

BASELINES: tuple[Method, ...] = ("linear", "arap")
COMPARED: tuple[Method, ...] = ("linear", "arap", "hinges", "ours")

Pictures = Callable[[int], UInt8[np.ndarray, "H W 3"]]
CodesOf = Callable[[int, int], Codes]
Predict = Callable[[Drawings, int], dict[str, Float[np.ndarray, "V 2"]]]


@dataclass(frozen=True)
class LeftOut:
    """Errors of each left-out drawing: ``errors[measure][method]`` lists one number per frame of ``frames``."""

    frames: tuple[int, ...]
    skipped: int
    errors: Mapping[str, Mapping[str, tuple[float, ...]]]

    def table(self) -> dict[str, dict[str, float]]:
        """Give the mean of every measure by method."""
        return {
            measure: {method: float(np.nanmean(values)) for method, values in by_method.items()}
            for measure, by_method in self.errors.items()
        }

    def ratio(self, method: str, measure: str) -> float:
        """Divide a method's mean by the better baseline's."""
        means = self.table()[measure]
        return means[method] / min(means[name] for name in BASELINES)


def leave_one_out(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    truth: Truth | None = None,
    pictures: Pictures | None = None,
    codes_of: CodesOf | None = None,
    only: tuple[int, ...] | None = None,
    progress: Progress = silent,
) -> LeftOut:
    """Score every method on a run; ``only`` names the frames to leave out (a model's test frames).

    ``pictures`` gives a frame's picture over white at the video's size. ``codes_of`` gives the codes of two frames
    and adds the method ``code``; its model must not have seen the frames.
    """
    tree, drawings = bone_tree_of(puppet), drawings_of(crops, fit)
    methods: tuple[Method, ...] = (*COMPARED, "code") if codes_of else COMPARED
    chosen = [k for k in range(1, len(drawings) - 1) if only is None or int(drawings.times[k]) in only]
    usable = [k for k in chosen if drawings.passage[k - 1] == drawings.passage[k + 1]]
    judges = _Judge(puppet, crops, fit, drawings, truth, pictures)
    errors: dict[str, dict[str, list[float]]] = {}
    for done, k in enumerate(usable):
        predicted = predictions(tree, drawings, k, methods, codes_of)
        judges.add(errors, tree, k, predicted)
        progress(done + 1, len(usable))
    frozen = {measure: {method: tuple(v) for method, v in rows.items()} for measure, rows in errors.items()}
    return LeftOut(tuple(int(drawings.times[k]) for k in usable), len(chosen) - len(usable), frozen)


def predictions(
    tree: BoneTree,
    drawings: Drawings,
    k: int,
    methods: tuple[Method, ...],
    codes_of: CodesOf | None = None,
) -> dict[str, Float[np.ndarray, "V 2"]]:
    """Predict drawing ``k`` from the others by each method."""
    rest = without(drawings, k)
    keys = with_winding(tree, rest, keys_of(rest, k - 1, k))
    share = np.array([(drawings.times[k] - keys.times.first) / (keys.times.last - keys.times.first)])
    strengths = strengths_of(tree, rest, k - 1, k)
    codes = codes_of(int(keys.times.first), int(keys.times.last)) if codes_of and "code" in methods else None
    return {method: between(tree, keys, share, method, strengths, codes)[0] for method in methods}


def without(drawings: Drawings, k: int) -> Drawings:
    """Take a drawing out; the passages stay."""
    kept = np.delete(np.arange(len(drawings)), k)
    arrays = {name: getattr(drawings, name)[kept] for name in ("rows", "times", "passage", "vertices", "order")}
    return replace(drawings, **arrays)


class _Judge:
    """Measures predictions of left-out drawings."""

    def __init__(
        self,
        puppet: Puppet,
        crops: Crops,
        fit: Fit,
        drawings: Drawings,
        truth: Truth | None,
        pictures: Pictures | None,
    ) -> None:
        self.puppet, self.drawings, self.truth, self.pictures = puppet, drawings, truth, pictures
        self.mesh = mesh_of(puppet)
        self.texture = texture_at(puppet, _scale(puppet, drawings.vertices))
        self.anchors: Anchors | None = None
        self.true_drawings: Drawings | None = None
        if truth is not None:
            self.anchors, self.true_drawings = _true_drawings(puppet, crops, fit, drawings, truth)

    def add(
        self,
        errors: dict[str, dict[str, list[float]]],
        tree: BoneTree,
        k: int,
        predicted: Mapping[str, Float[np.ndarray, "V 2"]],
    ) -> None:
        """Measure one drawing's predictions into ``errors``."""
        own = self.drawings.vertices[k]
        lines = self._lines(own, k)
        for method, vertices in predicted.items():
            _put(errors, "vertices", method, float(np.linalg.norm(vertices - own, axis=-1).mean()))
            _put(errors, "lines", method, chamfer(self._drawn_lines(vertices, k), lines))
            if self.anchors is not None:
                _put(errors, "points", method, self._points_error(vertices, k))
        if self.anchors is not None and self.true_drawings is not None:
            _put(errors, "fit_points", "fit", self._points_error(own, k))
            methods = tuple(method for method in COMPARED if method in predicted)
            if self.true_drawings.passage[k - 1] == self.true_drawings.passage[k + 1]:
                for method, vertices in predictions(tree, self.true_drawings, k, methods).items():
                    _put(errors, "true_points", method, self._points_error(vertices, k))

    def _points_error(self, vertices: Float[np.ndarray, "V 2"], k: int) -> float:
        assert self.truth is not None
        assert self.anchors is not None
        frame = int(self.drawings.times[k])
        counted = self.truth.visible[frame] & self.truth.visible[self.truth.reference]
        away = np.linalg.norm(self.anchors.mix(vertices[None])[0] - self.truth.points[frame], axis=-1)[counted]
        return float(away[np.isfinite(away)].mean()) if np.isfinite(away).any() else float("nan")

    def _lines(self, own: Float[np.ndarray, "V 2"], k: int) -> np.ndarray:
        if self.pictures is None:
            return self._drawn_lines(own, k)
        return lines_of(self.pictures(int(self.drawings.times[k])))

    def _drawn_lines(self, vertices: Float[np.ndarray, "V 2"], k: int) -> np.ndarray:
        order = orders_between(self.puppet, vertices[None], self.drawings.order[k - 1], self.drawings.order[k + 1])[0]
        return lines_of(drawn_on_white(self.mesh, self.texture, vertices, order, self._size()))

    def _size(self) -> tuple[int, int]:
        if self.pictures is not None:
            height, width = self.pictures(int(self.drawings.times[0])).shape[:2]
            return width, height
        width, height = np.ceil(self.drawings.vertices.max((0, 1))).astype(int).clip(16, 4096).tolist()
        return width, height


def _put(errors: dict[str, dict[str, list[float]]], measure: str, method: str, value: float) -> None:
    errors.setdefault(measure, {}).setdefault(method, []).append(value)


def _scale(puppet: Puppet, vertices: Float[np.ndarray, "D V 2"]) -> float:
    return float(np.median(np.ptp(vertices, axis=1) / np.ptp(puppet.vertices, axis=0)))


def _true_drawings(
    puppet: Puppet, crops: Crops, fit: Fit, drawings: Drawings, truth: Truth
) -> tuple[Anchors, Drawings]:
    """Tie the truth's points to the mesh at the reference, and pose the drawings by them."""
    row = int(np.flatnonzero(fit.frames == truth.reference)[0])
    base = apply(crops.video_from_crop[row], fit.vertices_crop[row].astype(np.float64))
    parts = [puppet.names[part] for part in truth.part]
    anchors = locate(puppet, base, fit.order[row], truth.points[truth.reference].astype(np.float64), parts)
    frames = drawings.times.astype(int)
    true = posed_by_points(puppet, base, anchors, truth.points[frames].astype(np.float64))
    return anchors, replace(drawings, vertices=true, passage=passages(true, drawings.passage))
