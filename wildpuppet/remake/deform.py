"""A frame of a run, dragged by handles: what a person writes down, where that is on the puppet, and the new pose.

A handle is ``part:x,y->x,y``: a point of a part as it stands in the frame, and where it is to go, both in video pixels.
With ``part:@x,y->x,y`` the point is given where it is on the puppet at rest (canvas pixels), for parts that are hidden.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.correspond.carry import frame_index
from wildpuppet.correspond.locate import locate
from wildpuppet.deform.model import Model
from wildpuppet.errors import InputError
from wildpuppet.export.overlay import Overlay, dimmed
from wildpuppet.export.preview import typical_scale
from wildpuppet.fit.handles import Handles
from wildpuppet.geometry.affine import apply, invert
from wildpuppet.motion.coded import Coded
from wildpuppet.motion.drag import Dragged, Known, drag
from wildpuppet.motion.pose_space import pose_space_of
from wildpuppet.recut import run_crops
from wildpuppet.remake.posed import Posed, boxes_of, window_of_all
from wildpuppet.runs import RunFolder
from wildpuppet.types import Fit, Puppet

NUMBER = r"([-+]?\d+(?:\.\d*)?|[-+]?\.\d+)"
HANDLE = re.compile(rf"(.+):(@?){NUMBER},{NUMBER}->{NUMBER},{NUMBER}")
BESIDE = 2.0
"""Pixels that a point may lie beside its part: a click is not exact."""
FROM_COLOUR, TO_COLOUR = (230, 60, 50), (30, 160, 60)

Picture = UInt8[np.ndarray, "_ _ 3"]


@dataclass(frozen=True)
class Handle:
    """What a person says: a point of a part, and where it is to go (video pixels).

    ``is_at_rest``: the point is in canvas pixels, on the puppet at rest.
    """

    part: str
    point: tuple[float, float]
    target: tuple[float, float]
    is_at_rest: bool = False


@dataclass(frozen=True, eq=False)
class Deformed:
    """A dragged frame. ``posed`` is a run of one frame, in the video's pixels; ``before`` is the pose that was dragged.

    ``decoded`` is what the codes alone say, before the last pixel is met over the vertices; ``points_video`` and
    ``targets_video`` are the handles before and after.
    """

    posed: Posed
    before: Float[np.ndarray, "V 2"]
    decoded: Float[np.ndarray, "V 2"]
    points_video: Float[np.ndarray, "N 2"]
    targets_video: Float[np.ndarray, "N 2"]

    @property
    def vertices(self) -> Float[np.ndarray, "V 2"]:
        """The new pose, video pixels."""
        return np.asarray(self.posed.fit.vertices_crop[0])


def handle_from(text: str) -> Handle:
    """Read ``part:x,y->x,y`` or ``part:@x,y->x,y``; raises InputError for anything else."""
    found = HANDLE.fullmatch(text.replace(" ", ""))
    if found is None or not found[1]:
        raise InputError(f"--handle {text}: expected part:x,y->x,y with numbers, such as hand:120,80->150,60")
    x, y, to_x, to_y = (float(found[k]) for k in range(3, 7))
    part = text.rpartition(":")[0].strip()
    return Handle(part, (x, y), (to_x, to_y), found[2] == "@")


def deformed_frame(
    run: RunFolder,
    frame: int,
    handles: Sequence[Handle],
    model: Model | None = None,
    source: Path | None = None,
) -> Deformed:
    """Drag frame ``frame`` of a run by handles; the rest follows as it did in the run's other frames.

    The draw order is that of the known frame whose pose is most like the result.

    Without ``model`` the codes are hinge rotations, without training; with it they are the network's, which reads the
    run's pictures (``source`` is where they lie now, when they were moved). Raises InputError for a frame outside of
    the run or without the character, a part that the puppet does not have and a point beside its part.
    """
    fit, crops = run.fit, run.crops
    row = frame_index(fit, frame)
    if fit.state[row] == "lost" or not np.isfinite(fit.vertices_crop[row]).all():
        raise InputError(f"frame {frame}: the character is lost there; choose a frame that shows it")
    if not handles:
        raise InputError("expected at least one handle: part:x,y->x,y")
    video_from_crop = crops.video_from_crop[row].astype(np.float64)
    before = apply(video_from_crop, fit.vertices_crop[row].astype(np.float64))
    held = _placed(run.puppet, before, fit.order[row], handles)
    in_crop = Handles(held.corners, held.weights, apply(invert(video_from_crop), held.targets))
    rows = known_rows(run, row)
    dragged = _drag(run, rows, row, in_crop, model, source)
    like = int(rows[((fit.vertices_crop[rows] - dragged.vertices) ** 2).sum((1, 2)).argmin()])
    vertices, decoded = apply(video_from_crop, dragged.vertices), apply(video_from_crop, dragged.decoded)
    made_by = {
        "command": "deform", "run": str(run.folder.absolute()), "frame": frame,
        "handles": [_text(handle) for handle in handles], "by": "poses" if model is None else "model",
        "order_of_frame": int(fit.frames[like]),
    }  # fmt: skip
    posed = _posed(run, row, vertices, fit.order[like], made_by)
    return Deformed(posed, before, decoded, held.points(before), held.targets)


def _drag(
    run: RunFolder, rows: Int[np.ndarray, "K"], row: int, handles: Handles, model: Model | None, source: Path | None
) -> Dragged:
    poses = run.fit.vertices_crop[rows].astype(np.float64)
    start, unit = int(np.flatnonzero(rows == row)[0]), 2.0 / max(run.crops.size)
    trust = run.fit.confidence[rows].mean(1).astype(np.float64)
    if model is None:
        space = pose_space_of(run.puppet)
        known = Known(poses, space.encode(poses, poses[start]), space.turnings(), trust)
        return drag(run.puppet, space, known, start, handles, unit)
    codes = _codes(run, rows, model, source)
    coded = Coded(model, run.crops.size)
    known = Known(poses, codes, np.zeros((0, codes.shape[1])), trust)
    return drag(run.puppet, coded, known, start, handles, unit)


def _codes(run: RunFolder, rows: Int[np.ndarray, "K"], model: Model, source: Path | None) -> Float[np.ndarray, "K Z"]:
    """Find the known poses' codes: of the fits where the network's skeleton has them, else of the pictures."""
    scale = np.array(model.size, np.float64) / np.array(run.crops.size, np.float64)
    if model.recipe == "ours":
        return model.codes_of(run.fit.vertices_crop[rows].astype(np.float64) * scale, run.fit.confidence[rows])
    pictures = run_crops(run, source).images
    return np.concatenate([model.encode(pictures[each : each + 1]) for each in rows.tolist()])


def known_rows(run: RunFolder, row: int) -> Int[np.ndarray, "K"]:
    """List the frames whose poses are known: one per drawing, found and not doubted, and the frame ``row`` itself."""
    fit = run.fit
    _, first = np.unique(run.crops.drawing, return_index=True)
    is_known = np.array([state == "fitted" for state in fit.state]) & np.isfinite(fit.vertices_crop).all((1, 2))
    same = first[run.crops.drawing[first] == run.crops.drawing[row]]
    return np.union1d(np.setdiff1d(first[is_known[first]], same), [row]).astype(np.int64)


def _placed(
    puppet: Puppet, vertices: Float[np.ndarray, "V 2"], order: Int[np.ndarray, "L"], handles: Sequence[Handle]
) -> Handles:
    """Find the handles on the mesh."""
    corners, weights = [], []
    for handle in handles:
        _check_part(puppet, handle)
        shape = puppet.vertices.astype(np.float64) if handle.is_at_rest else vertices
        anchor = locate(puppet, shape, order, np.array([handle.point]), [handle.part])
        if anchor.outside[0] > BESIDE:
            beside = _beside(puppet, shape, handle, float(anchor.outside[0]))
            raise InputError(f"handle {_text(handle)}: {beside}")
        corners.append(anchor.corners[0])
        weights.append(anchor.weights[0])
    return Handles(np.stack(corners), np.stack(weights), np.array([handle.target for handle in handles]))


def _check_part(puppet: Puppet, handle: Handle) -> None:
    if handle.part not in puppet.names:
        known = ", ".join(puppet.names)
        raise InputError(f"handle {_text(handle)}: expected one of the puppet's parts ({known}), found {handle.part!r}")
    if not all(math.isfinite(value) for value in (*handle.point, *handle.target)):
        raise InputError(f"handle {_text(handle)}: expected numbers")


def _beside(puppet: Puppet, shape: Float[np.ndarray, "V 2"], handle: Handle, away: float) -> str:
    where = "the puppet at rest" if handle.is_at_rest else "the frame"
    mine = shape[puppet.layer_of_vertex == puppet.names.index(handle.part)]
    (left, top), (right, bottom) = np.rint(mine.min(0)), np.rint(mine.max(0))
    return (
        f"the point is {away:.0f} pixels outside of {handle.part}, which spans "
        f"{left:.0f},{top:.0f} to {right:.0f},{bottom:.0f} in {where}"
    )


def _text(handle: Handle) -> str:
    mark = "@" if handle.is_at_rest else ""
    (x, y), (to_x, to_y) = handle.point, handle.target
    return f"{handle.part}:{mark}{x:g},{y:g}->{to_x:g},{to_y:g}"


def _posed(
    run: RunFolder,
    row: int,
    vertices: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
    made_by: Mapping[str, object],
) -> Posed:
    """Make a run of one frame."""
    fit, frames = run.fit, run.fit.frames[row : row + 1].copy()
    made = Fit(frames, vertices[None], order[None].copy(), fit.confidence[row : row + 1].copy(), ("fitted",))
    crops = window_of_all(run.size, frames, boxes_of(vertices[None]), run.crops.ordered)
    times = None if run.times is None else (run.times[0][row : row + 1], run.times[1])
    return Posed(run.puppet, crops, made, run.size, times, made_by)


def preview(deformed: Deformed, picture: Picture) -> Picture:
    """Draw the pose before (wireframe, handles with arrows) beside the pose after, over the frame's picture."""
    posed = deformed.posed
    order, scale = posed.fit.order[0], typical_scale(posed.puppet, posed.fit.vertices_crop, posed.fit)
    overlay = Overlay(posed.puppet, scale)
    left = overlay.wireframe(dimmed(picture) // 2 + picture // 2, deformed.before, order)
    right = overlay.redrawn(picture, deformed.vertices, order)
    for start, target in zip(deformed.points_video, deformed.targets_video, strict=True):
        _arrow(left, start, target)
        _dot(right, target, TO_COLOUR)
    return np.concatenate([left, right], 1)


def _arrow(picture: Picture, start: Float[np.ndarray, "2"], target: Float[np.ndarray, "2"]) -> None:
    ends = [(round(float(x) - 0.5), round(float(y) - 0.5)) for x, y in (start, target)]
    cv2.arrowedLine(picture, ends[0], ends[1], (255, 255, 255), 3, cv2.LINE_AA, tipLength=0.15)
    cv2.arrowedLine(picture, ends[0], ends[1], FROM_COLOUR, 1, cv2.LINE_AA, tipLength=0.15)
    _dot(picture, start, FROM_COLOUR)
    _dot(picture, target, TO_COLOUR)


def _dot(picture: Picture, at: Float[np.ndarray, "2"], colour: tuple[int, int, int]) -> None:
    centre = (round(float(at[0]) - 0.5), round(float(at[1]) - 0.5))
    cv2.circle(picture, centre, 5, (255, 255, 255), -1, cv2.LINE_AA)
    cv2.circle(picture, centre, 4, colour, -1, cv2.LINE_AA)
