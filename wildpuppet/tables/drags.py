"""Table 4: a few points of the reference drawing dragged to a test drawing: how right is the whole pose then?

The start is the fit of the reference drawing, or of the training drawing nearest in number where that is doubted. The
first handle is the point that has the farthest to go, each further one the point farthest from the handles there are.
All points that are seen in both drawings count. Ours drags through the poses of the training drawings' fits, the
baseline lowers the paper's energy over the vertices; ``start`` does nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.correspond.locate import Anchors, locate
from wildpuppet.correspond.pck import Truth
from wildpuppet.fit.handles import Handles, deform_energy
from wildpuppet.fit.pull_vertices import pull_vertices
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import Progress, silent
from wildpuppet.motion.drag import Known, drag
from wildpuppet.motion.lines import drawn_on_white
from wildpuppet.motion.pose_space import pose_space_of
from wildpuppet.render.render import mesh_of, texture_at
from wildpuppet.types import Crops, Fit, Puppet

Picture = UInt8[np.ndarray, "H W 3"]

COUNTS = (1, 2, 3)
MOST = 12
"""Test drawings that are dragged to, evenly spread."""


@dataclass(frozen=True, eq=False)
class Case:
    """One test drawing: the known pose to start from and the points, all in video pixels."""

    start: int
    anchors: Anchors
    target: Float[np.ndarray, "N 2"]
    seen: Bool[np.ndarray, "N"]


class Dragging:
    """Drags one run's reference drawing to test drawings; ``frames`` are never among the known poses."""

    def __init__(self, puppet: Puppet, crops: Crops, fit: Fit, truth: Truth, frames: Sequence[int]) -> None:
        self.puppet, self.fit, self.truth = puppet, fit, truth
        self.vertices = apply(crops.video_from_crop, fit.vertices_crop.astype(np.float64))
        is_known = np.array([state in ("fitted", "held") for state in fit.state]) & ~np.isin(fit.frames, frames)
        self.rows = np.flatnonzero(is_known)
        self.space = pose_space_of(puppet)

    def case(self, frame: int) -> Case:
        """Tie the truth's points to the mesh where they are in the drawing that is dragged."""
        return case_of(self.puppet, self.fit, self.vertices, self.truth, frame, self.rows)

    def answers(self, case: Case, count: int) -> dict[str, Float[np.ndarray, "V 2"]]:
        """Drag by so many handles, by every method; video pixels."""
        poses = self.vertices[self.rows]
        start, unit = poses[case.start], 2.0 / float(np.ptp(poses, axis=1).max())
        known = Known(poses, self.space.encode(poses, start), self.space.turnings())
        handles = handles_of(case, start, count)
        return {
            "start": start,
            "vertices": pull_vertices(deform_energy(self.puppet, start, handles, unit), start),
            "ours": drag(self.puppet, self.space, known, case.start, handles, unit).vertices,
        }


def drag_scores(
    puppet: Puppet, crops: Crops, fit: Fit, truth: Truth, frames: Sequence[int], progress: Progress = silent
) -> tuple[dict[tuple[str, int], float], int]:
    """Give the mean distance of points from where they are, for (method, number of handles), and how many drawings.

    ``frames`` are the test drawings; only their truth is used, not their fits.
    """
    dragging = Dragging(puppet, crops, fit, truth, frames)
    if len(dragging.rows) < 2:
        return {}, 0
    errors: dict[tuple[str, int], list[float]] = {}
    chosen = spread_over(frames, MOST)
    for done, frame in enumerate(chosen, 1):
        case = dragging.case(frame)
        for count in COUNTS:
            for method, pose in dragging.answers(case, count).items():
                errors.setdefault((method, count), []).append(_error(case, pose))
        progress(done, len(chosen))
    return {name: float(np.nanmean(values)) for name, values in errors.items()}, len(chosen)


def drag_rows(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    truth: Truth,
    frames: Sequence[int],
    picture: Callable[[int], Picture],
    rows: int,
) -> dict[str, list[Picture]]:
    """Draw test drawings and what three handles make of the reference drawing, a column per method."""
    dragging, mesh, texture = Dragging(puppet, crops, fit, truth, frames), mesh_of(puppet), texture_at(puppet, 1.0)
    columns: dict[str, list[Picture]] = {}
    for frame in spread_over(frames, rows):
        drawing, case = picture(frame), dragging.case(frame)
        order = fit.order[dragging.rows[case.start]]
        answers = dragging.answers(case, max(COUNTS))
        handles = handles_of(case, answers["start"], max(COUNTS))
        columns.setdefault("drawing", []).append(drawing)
        for method, pose in answers.items():
            drawn = drawn_on_white(mesh, texture, pose, order, (drawing.shape[1], drawing.shape[0]))
            columns.setdefault(method, []).append(_with_handles(drawn, handles))
    return columns


def spread_over(frames: Sequence[int], most: int) -> list[int]:
    """Choose up to ``most`` of the frames, evenly spread."""
    places = np.linspace(0, len(frames) - 1, min(len(frames), most)).round().astype(int)
    return [frames[place] for place in np.unique(places).tolist()]


def _with_handles(picture: Picture, handles: Handles) -> Picture:
    marked = picture.copy()
    for x, y in handles.targets.tolist():
        cv2.circle(marked, (round(x - 0.5), round(y - 0.5)), 5, (220, 30, 30), -1, cv2.LINE_AA)
    return marked


def case_of(
    puppet: Puppet,
    fit: Fit,
    vertices: Float[np.ndarray, "T V 2"],
    truth: Truth,
    frame: int,
    rows: Int[np.ndarray, "K"],
) -> Case:
    """Choose the start and tie the points to the mesh where they are in its drawing."""
    start = int(np.abs(fit.frames[rows] - truth.reference).argmin())
    row = int(rows[start])
    shown = int(fit.frames[row])
    parts = [puppet.names[part] for part in truth.part]
    anchors = locate(puppet, vertices[row], fit.order[row], truth.points[shown].astype(np.float64), parts)
    seen = truth.visible[shown] & truth.visible[frame] & np.isfinite(truth.points[[shown, frame]]).all((0, 2))
    return Case(start, anchors, truth.points[frame].astype(np.float64), seen)


def handles_of(case: Case, start: Float[np.ndarray, "V 2"], count: int) -> Handles:
    """Choose handles among the points that are seen."""
    places = case.anchors.mix(start[None])[0]
    way = np.where(case.seen, np.linalg.norm(places - case.target, axis=-1), -1.0)
    chosen = [int(way.argmax())]
    while len(chosen) < min(count, int(case.seen.sum())):
        away = np.linalg.norm(places[:, None] - places[chosen], axis=-1).min(1)
        chosen.append(int(np.where(case.seen, away, -1.0).argmax()))
    return Handles(case.anchors.corners[chosen], case.anchors.weights[chosen], case.target[chosen])


def _error(case: Case, pose: Float[np.ndarray, "V 2"]) -> float:
    away = np.linalg.norm(case.anchors.mix(pose[None])[0] - case.target, axis=-1)[case.seen]
    return float(away.mean()) if len(away) else float("nan")
