"""Keyframes: a pose, or points of it, that a person fixed in one frame; reading them, and what the choice is given.

A points file is a csv with a header; each row is a point of a part at rest and where that point is in the frame:

    part,canvas_x,canvas_y,x,y
    left_forearm,153,154,301.5,220

canvas_x, canvas_y are pixels of the puppet's canvas (of ``parts/left_forearm.png``), x, y pixels of the video. One
point moves a part, two or more turn it too. A pose file is an npz with ``vertices_video`` (V, 2), video pixels, as one
frame of meshes.npz, and with ``order`` (L,), layers back to front, if that is to be fixed as well.
"""

import csv
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.errors import InputError
from wildpuppet.types import Followed, Hypotheses, Keyframe, Puppet

COLUMNS = ("part", "canvas_x", "canvas_y", "x", "y")
HEADER = ",".join(COLUMNS)
BESIDE = 0.5
"""A point beside its part's mesh may lie outside a triangle by this share of the triangle's height."""


def read_keyframe(path: Path, frame: int, puppet: Puppet) -> Keyframe:
    """Read what a person fixed in ``frame``: a points csv, or an npz with vertices.

    Raises InputError, one line: which file and line, what was expected, what was found.
    """
    if path.suffix.lower() == ".npz":
        return _read_vertices(path, frame, puppet)
    rows = _read_rows(path)
    corners, weights = zip(*(_anchor(puppet, *row[:3]) for row in rows), strict=True)
    points = np.array([row[3] for row in rows], np.float64)
    return Keyframe(frame, np.stack(corners), np.stack(weights), points)


def _read_vertices(path: Path, frame: int, puppet: Puppet) -> Keyframe:
    try:
        with np.load(path, allow_pickle=False) as stored:
            found = {name: np.asarray(stored[name]) for name in ("vertices_video", "order") if name in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: expected an npz with vertices_video, found {_what(error)}") from None
    vertices, number = found.get("vertices_video"), len(puppet.vertices)
    if vertices is None:
        raise InputError(f"{path}: expected an array vertices_video ({number}, 2), found none of that name")
    if vertices.shape != (number, 2) or vertices.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: expected vertices_video of shape ({number}, 2), as the puppet has, found {vertices.shape}; "
            "of meshes.npz take one frame"
        )
    if not np.isfinite(vertices).all():
        raise InputError(f"{path}: expected finite vertices_video, found NaN or infinity")
    order = found.get("order")
    if order is not None and sorted(order.ravel().tolist()) != list(range(puppet.num_layers)):
        raise InputError(f"{path}: expected order to list the layers 0 to {puppet.num_layers - 1} once, back to front")
    empty = np.zeros((0, 3))
    given = None if order is None else order.ravel().astype(np.int64)
    return Keyframe(frame, empty.astype(np.int64), empty, np.zeros((0, 2)), vertices.astype(np.float64), given)


Row = tuple[str, str, Float[np.ndarray, "2"], tuple[float, float]]
"""Where the row stands, the part, the point at rest, and where it is."""


def _read_rows(path: Path) -> list[Row]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected a csv of {HEADER} or an npz, found {_what(error)}") from None
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise InputError(f"{path}: expected a header with {HEADER}, found no {' and no '.join(missing)}")
    rows: list[Row] = []
    for cells in reader:
        where = f"{path}, line {reader.line_num}"
        try:
            numbers = [float(cells[name]) for name in COLUMNS[1:]]
        except (TypeError, ValueError):
            numbers = [math.nan]
        if not all(map(math.isfinite, numbers)):
            found = ",".join(str(cells[name] or "") for name in COLUMNS)
            raise InputError(f"{where}: expected {HEADER} with four numbers, found {found!r}")
        rows.append((where, str(cells["part"]).strip(), np.array(numbers[:2]), (numbers[2], numbers[3])))
    if not rows:
        raise InputError(f"{path}: expected rows of {HEADER}, found none")
    return rows


def _what(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "no such file"
    return f"one that cannot be read ({' '.join(str(error).split()) or type(error).__name__})"


def _anchor(
    puppet: Puppet, where: str, part: str, point: Float[np.ndarray, "2"]
) -> tuple[Int[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Find the triangle of the part that a canvas point lies in (or nearly), and the point's barycentrics."""
    if part not in puppet.names:
        raise InputError(f"{where}: expected one of the puppet's parts ({', '.join(puppet.names)}), found {part!r}")
    triangles = puppet.triangles[puppet.layer_of_triangle == puppet.names.index(part)]
    a, b, c = (puppet.vertices[triangles[:, k]].astype(np.float64) for k in range(3))
    sides = np.stack([b - a, c - a], -1)
    second, third = np.linalg.solve(sides, (point - a)[..., None])[..., 0].T
    weights = np.stack([1 - second - third, second, third], -1)
    best = int(weights.min(1).argmax())
    if weights[best].min() < -BESIDE:
        x, y = point.tolist()
        raise InputError(f"{where}: expected a point of {part} on the puppet's canvas, found {x:g},{y:g} beside it")
    return triangles[best].astype(np.int64), weights[best]


def joined(hypotheses: Hypotheses, followed: Sequence[Followed]) -> Hypotheses:
    """Let the poses of keyframes stand alone in their frames and stand beside the others in frames around them.

    What follows a keyframe ends before the next one. Frames that no keyframe touches keep their hypotheses, with more
    of infinite cost.
    """
    fixed = {int(frame) for one in followed for frame in one.frames[one.is_fixed]}
    added: dict[int, list[tuple[Followed, int]]] = {}
    for one in followed:
        own = {int(frame) for frame in one.frames[one.is_fixed]}
        for row, frame in enumerate(one.frames.tolist()):
            low, high = min(frame, *own), max(frame, *own)
            if not any(low <= other <= high for other in fixed - own):
                added.setdefault(frame, []).append((one, row))
    extra = max((len(rows) for rows in added.values()), default=0)
    maps, order, cost = (_widened(array, extra) for array in _arrays(hypotheses))
    num_before = hypotheses.cost.shape[1]
    cost[:, num_before:] = np.inf
    for frame, rows in added.items():
        for column, (one, row) in enumerate(rows, num_before):
            values = one.crop_from_canvas[row], one.order[row], one.cost[row]
            place: int | slice = column
            if one.is_fixed[row]:
                cost[frame], place = np.inf, slice(None)
            maps[frame, place], order[frame, place] = values[:2]
            cost[frame, 0 if one.is_fixed[row] else column] = values[2]
    return Hypotheses(maps, order, cost)


def _arrays(hypotheses: Hypotheses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return hypotheses.crop_from_canvas, hypotheses.order, hypotheses.cost


def _widened(array: np.ndarray, by: int) -> np.ndarray:
    return np.concatenate([array, np.repeat(array[:, -1:], by, 1)], 1)
