"""Table 4: drag points of a drawing to where they are in another: how right is the whole pose then?

    scores = drag_scores(run.puppet, run.crops, run.fit, read_truth(Path("bench/gbot/gt.npz")))
    scores.mean("ours", 2), scores.mean("vertices", 2)      # two handles: mean error in pixels

Every drawing kept for testing is reached from the training drawing before it. One to three of its points are dragged to
their true places; all points that are seen in it and in the reference count. The first handle is the point that has
the farthest to go, each further one the farthest among those that are not near a handle.

``start`` does nothing. ``printed`` is the paper's energy over the vertices (against the puppet at rest, hinges closed),
``vertices`` the better baseline (against the pose that is dragged, hinges as open as there), both converged. ``paper``
takes the paper's plain steps in the code, ``ours`` is ``motion/drag.py``. Known poses and the start are the run's own
fits of training drawings, or (``by_truth``) those drawings posed by their true points: what dragging alone loses.
Points that the start has wrong in its own drawing (a swapped limb) are neither dragged nor counted: no person would
drag a point of one hand to where the other is.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.correspond.locate import Anchors, locate
from wildpuppet.correspond.pck import Truth
from wildpuppet.fit.handles import Handles, deform_energy
from wildpuppet.fit.pull_codes import decode, plain_steps
from wildpuppet.fit.pull_vertices import pull_vertices
from wildpuppet.geometry.affine import apply
from wildpuppet.geometry.arap import arap_rest, best_scale_of
from wildpuppet.machine import Progress, silent
from wildpuppet.motion.drag import Known, drag
from wildpuppet.motion.lines import drawn_on_white
from wildpuppet.motion.pose_space import PoseSpace, pose_space_of
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.similarity import placed, similarities
from wildpuppet.render.render import mesh_of, texture_at
from wildpuppet.types import Crops, Fit, Puppet

Picture = UInt8[np.ndarray, "H W 3"]
COUNTS = (1, 2, 3)
TRUE_RIGID, TRUE_HOLD = 0.05, 1e-3
"""How little stiffness and hold count beside true points."""
WRONG = 0.05
"""A point of the start is wrong from this share of the picture's larger side on."""
APART = 0.15
"""Handles are at least this share of the picture's larger side apart."""
LEAST_KNOWN = 2
"""Known poses without which there is nothing to learn from."""


@dataclass(frozen=True)
class DragScores:
    """``errors[method, count]`` lists the mean error of each of ``frames``, video pixels; ``length`` is L."""

    frames: tuple[int, ...]
    length: float
    errors: Mapping[tuple[str, int], tuple[float, ...]]

    def mean(self, method: str, count: int) -> float:
        """Average over the drawings, pixels."""
        return float(np.mean(self.errors[method, count]))

    def ratio(self, count: int, method: str = "ours", baseline: str = "vertices") -> float:
        """Compare two methods' means."""
        return self.mean(method, count) / self.mean(baseline, count)


def drag_scores(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    truth: Truth,
    by_truth: bool = False,
    most: int | None = None,
    progress: Progress = silent,
) -> DragScores:
    """Drag to every drawing of ``truth.test`` or to so many, evenly spread; drawings only (one window for all frames).

    Drawings of which no point counts are left out; all are where fewer than ``LEAST_KNOWN`` training drawings are not
    doubted. Raises ValueError without ``truth.test``.
    """
    if truth.test is None:
        raise ValueError("expected a truth with drawings kept for testing")
    scene = _scene(puppet, crops, fit, truth, by_truth)
    frames = scene.dragged(truth.test.tolist(), len(truth.test) if most is None else most)
    errors: dict[tuple[str, int], list[float]] = {}
    for done, frame in enumerate(frames, 1):
        known = scene.known(frame)
        for count in COUNTS:
            handles = _handles(scene, frame, count)
            for method, pose in _answers(puppet, scene, frame, handles, known).items():
                errors.setdefault((method, count), []).append(scene.error(pose, frame))
        progress(done, len(frames))
    return DragScores(tuple(frames), float(truth.length.max()), {name: tuple(found) for name, found in errors.items()})


def drag_rows(
    puppet: Puppet, crops: Crops, fit: Fit, truth: Truth, picture: Callable[[int], Picture], rows: int
) -> dict[str, list[Picture]]:
    """Draw test drawings and what ``max(COUNTS)`` handles make of the drawing before, a column per method."""
    assert truth.test is not None
    scene = _scene(puppet, crops, fit, truth, by_truth=False)
    mesh, texture, window = mesh_of(puppet), texture_at(puppet, 1.0), crops.video_from_crop[0].astype(np.float64)
    columns: dict[str, list[Picture]] = {}
    for frame in scene.dragged(truth.test.tolist(), rows):
        drawing, order = picture(frame), fit.order[scene.rows[scene.start(frame)]]
        handles = _handles(scene, frame, max(COUNTS))
        columns.setdefault("drawing", []).append(drawing)
        for method, pose in _answers(puppet, scene, frame, handles, scene.known(frame)).items():
            drawn = drawn_on_white(mesh, texture, apply(window, pose), order, (drawing.shape[1], drawing.shape[0]))
            columns.setdefault(method, []).append(_with_handles(drawn, apply(window, handles.targets)))
    return columns


def spread_over(frames: Sequence[int], most: int) -> list[int]:
    """Choose up to ``most`` of the frames, evenly spread."""
    places = np.linspace(0, len(frames) - 1, min(len(frames), most)).round().astype(int)
    return [frames[place] for place in np.unique(places).tolist()]


def _with_handles(picture: Picture, places: Float[np.ndarray, "n 2"]) -> Picture:
    marked = picture.copy()
    for x, y in places.tolist():
        cv2.circle(marked, (round(x - 0.5), round(y - 0.5)), 5, (220, 30, 30), -1, cv2.LINE_AA)
    return marked


@dataclass(frozen=True, eq=False)
class _Scene:
    """The training drawings' poses, and where the true points are; crop pixels. ``rows`` are drawings' numbers."""

    anchors: Anchors
    points: Float[np.ndarray, "T N 2"]
    seen: Bool[np.ndarray, "T N"]
    rows: Int[np.ndarray, "K"]
    poses: Float[np.ndarray, "K V 2"]
    trust: Float[np.ndarray, "K"]
    unit: float
    video_per_crop: float
    space: PoseSpace

    def start(self, frame: int) -> int:
        """Row of the training drawing before a drawing (after it, if there is none)."""
        return max(0, int(np.searchsorted(self.rows, frame)) - 1)

    def known(self, frame: int) -> Known:
        """Take hinge rotations for the known poses' codes, as seen from a drawing's start."""
        codes = self.space.encode(self.poses, self.poses[self.start(frame)])
        return Known(self.poses, codes, self.space.turnings(), self.trust)

    def rest(self, puppet: Puppet, pose: Float[np.ndarray, "V 2"]) -> Float[np.ndarray, "V 2"]:
        """Give the puppet at rest at the size that it has in a pose."""
        rest = arap_rest(puppet.vertices.astype(np.float64), puppet.triangles)
        return np.asarray(puppet.vertices * float(best_scale_of(pose[None], rest)[0]))

    def dragged(self, frames: Sequence[int], most: int) -> list[int]:
        """Choose up to ``most`` of the drawings of which points count; none where too few poses are known."""
        return spread_over(
            [frame for frame in frames if len(self.rows) >= LEAST_KNOWN and len(self.counted(frame))], most
        )

    def counted(self, frame: int) -> Int[np.ndarray, "n"]:
        """List the points that are seen in a drawing and that its start has right."""
        row = self.start(frame)
        away = np.linalg.norm(self.anchors.mix(self.poses[row][None])[0] - self.points[self.rows[row]], axis=-1)
        return np.flatnonzero(self.seen[frame] & ~(away > WRONG * 2.0 / self.unit))

    def error(self, pose: Float[np.ndarray, "V 2"], frame: int) -> float:
        """Mean distance of the counted points, video pixels."""
        away = np.linalg.norm(self.anchors.mix(pose[None])[0] - self.points[frame], axis=-1)
        return float(away[self.counted(frame)].mean()) * self.video_per_crop


def _scene(puppet: Puppet, crops: Crops, fit: Fit, truth: Truth, by_truth: bool) -> _Scene:
    window = crops.video_from_crop[0].astype(np.float64)
    scale = float(window[0, 0])
    points = (truth.points.astype(np.float64) - window[:, 2]) / scale
    base = fit.vertices_crop[truth.reference].astype(np.float64)
    parts = [puppet.names[part] for part in truth.part]
    anchors = locate(puppet, base, fit.order[truth.reference], points[truth.reference], parts)
    assert truth.test is not None
    is_known = ~np.isin(np.arange(len(points)), truth.test)
    if not by_truth:
        is_known &= np.array([state in ("fitted", "held") for state in fit.state])
    rows = np.flatnonzero(is_known)
    given = truth.visible[truth.reference] & np.isfinite(anchors.weights).all(1)
    poses = fit.vertices_crop[rows].astype(np.float64)
    unit, trust = 2.0 / max(crops.size), fit.confidence[rows].mean(1).astype(np.float64)
    if by_truth:
        trust = np.ones(len(rows))
        true = np.where(given[:, None], points[rows], np.nan)
        poses = np.stack([_posed_by_truth(puppet, *each, anchors, unit) for each in zip(poses, true, strict=True)])
    seen = truth.visible & given & np.isfinite(points).all(-1)
    return _Scene(anchors, points, seen, rows, poses, trust, unit, scale, pose_space_of(puppet))


def _posed_by_truth(
    puppet: Puppet, pose: Float[np.ndarray, "V 2"], points: Float[np.ndarray, "N 2"], anchors: Anchors, unit: float
) -> Float[np.ndarray, "V 2"]:
    """Bend the puppet through points that are known, parts without any as the hinges say; start from a fitted pose."""
    known = np.isfinite(points).all(1)
    maps = similarities(puppet, pose[None])[0]
    at_rest = anchors.mix(puppet.vertices[None])[0][known]
    start = pose_vertices(puppet, placed(maps, anchors.layer[known], at_rest, points[known]))
    size = float(np.median(np.sqrt(np.abs(np.linalg.det(maps[:, :, :2])))))
    handles = Handles(anchors.corners[known], anchors.weights[known], points[known])
    return pull_vertices(deform_energy(puppet, size * puppet.vertices, handles, unit, TRUE_RIGID), start, TRUE_HOLD, 20)


def _handles(scene: _Scene, frame: int, count: int) -> Handles:
    seen = scene.counted(frame)
    places = scene.anchors.mix(scene.poses[scene.start(frame)][None])[0][seen]
    chosen = seen[_farthest(places, scene.points[frame][seen], count, APART * 2.0 / scene.unit)]
    return Handles(scene.anchors.corners[chosen], scene.anchors.weights[chosen], scene.points[frame][chosen])


def _farthest(
    places: Float[np.ndarray, "n 2"], targets: Float[np.ndarray, "n 2"], count: int, apart: float
) -> Int[np.ndarray, "c"]:
    way = np.linalg.norm(places - targets, axis=-1)
    chosen: list[int] = []
    while len(chosen) < count and way.max() >= 0:
        chosen.append(int(way.argmax()))
        way = np.where(np.linalg.norm(places - places[chosen[-1]], axis=-1) < apart, -1.0, way)
    return np.array(chosen, np.int64)


def _answers(
    puppet: Puppet, scene: _Scene, frame: int, handles: Handles, known: Known
) -> dict[str, Float[np.ndarray, "V 2"]]:
    row = scene.start(frame)
    start, decoder = scene.poses[row], scene.space
    energy = deform_energy(puppet, start, handles, scene.unit)
    stepped = plain_steps(energy, decoder, known.codes[row])
    return {
        "start": start,
        "printed": pull_vertices(deform_energy(puppet, scene.rest(puppet, start), handles, scene.unit), start),
        "vertices": pull_vertices(energy, start),
        "paper": decode(decoder, stepped) + start - decode(decoder, known.codes[row]),
        "ours": drag(puppet, decoder, known, row, handles, scene.unit).vertices,
    }
