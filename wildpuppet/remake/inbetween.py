"""Inbetweens of a run's two frames, or of two pictures that a model reads."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.deform.model import Model
from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import apply
from wildpuppet.motion.bones import bone_tree_of
from wildpuppet.motion.curves import Times
from wildpuppet.motion.draw_order import orders_between
from wildpuppet.motion.inbetween import Codes, Keys, Method, between, even_shares, keys_of, strengths_of, with_winding
from wildpuppet.motion.passages import Drawings, drawings_of
from wildpuppet.recut import run_crops
from wildpuppet.remake.pictures import framed, read_pair
from wildpuppet.remake.posed import Posed, boxes_of, window_of_all
from wildpuppet.runs import RunFolder
from wildpuppet.types import Fit, FitState, Puppet

SIZE = 1024
MOST_SIZE = 16384
MOST_COUNT = 10000


@dataclass(frozen=True, eq=False)
class Inbetweens:
    """The first key, ``count`` poses and the last key; ``posed`` in pixels of the picture that is drawn.

    ``picture_from_video`` is where the run's pixels are in it. ``nearest[t]`` is the frame of the run whose drawing is
    most like pose t, ``nearest_vertices[t]`` its pose and ``away[t]`` their mean distance, in video pixels; empty where
    there is no run.
    """

    posed: Posed
    picture_from_video: Float[np.ndarray, "2 3"]
    nearest: tuple[int, ...] = ()
    away: tuple[float, ...] = ()
    nearest_vertices: Float[np.ndarray, "T V 2"] | None = None


def inbetweens_of_run(
    run: RunFolder,
    frames: tuple[int, int],
    count: int,
    method: Method = "ours",
    model: Model | None = None,
    size: int = SIZE,
    closely: bool = False,
    source: Path | None = None,
) -> Inbetweens:
    """Make ``count`` poses between two frames of a run.

    ``size`` is the picture's larger side; it shows the run's whole picture, or with ``closely`` the character alone.
    ``model`` is needed for ``code`` only. Raises InputError for frames that the run does not have, or in which the
    character is lost, or that show one drawing.
    """
    _check(count, size)
    drawings, low, high = _drawings(run, frames)
    tree = bone_tree_of(run.puppet)
    keys = with_winding(tree, drawings, keys_of(drawings, low, high), np.arange(low + 1, high))
    strengths = strengths_of(tree, drawings, low, high) if method == "ours" else None
    rows = (int(drawings.rows[low]), int(drawings.rows[high]))
    codes = _codes_of_run(run, model, rows, source) if method == "code" else None
    poses = between(tree, keys, even_shares(count), method, strengths, codes)
    orders = orders_between(run.puppet, poses, drawings.order[low], drawings.order[high])
    vertices = np.concatenate([keys.vertices[1:2], poses, keys.vertices[2:3]])
    order = np.concatenate([drawings.order[low : low + 1], orders, drawings.order[high : high + 1]])
    if frames[0] > frames[1]:
        vertices, order = vertices[::-1], order[::-1]
    trust = run.fit.confidence[list(rows)].min(0)
    made_by = {
        "command": "inbetween", "run": str(run.folder.absolute()), "frames": list(frames), "count": count,
        "method": method, "strengths": {kind: round(value, 4) for kind, value in (strengths or {}).items()},
    }  # fmt: skip
    near, away = _nearest(drawings, vertices)
    posed, placed = _posed(run.puppet, vertices, order, trust, run.size, size, closely, _rate(run), made_by)
    frames_near = tuple(int(frame) for frame in drawings.times[near])
    return Inbetweens(posed, placed, frames_near, away, drawings.vertices[near])


def _drawings(run: RunFolder, frames: tuple[int, int]) -> tuple[Drawings, int, int]:
    """List the run's drawings, and where among them the earlier and the later key are."""
    first, last = (_row_of(run, frame) for frame in frames)
    if np.array_equal(run.animation.vertices(first), run.animation.vertices(last)):
        raise InputError(f"--frames {frames[0]} {frames[1]}: expected two drawings, found one and the same")
    drawings = drawings_of(run.crops, run.fit, frames)
    low, high = (int(np.flatnonzero(drawings.rows == row)[0]) for row in sorted((first, last)))
    return drawings, low, high


def inbetweens_of_pictures(
    pictures: Sequence[Path],
    count: int,
    model: Model,
    method: Method = "code",
    size: int = SIZE,
    closely: bool = False,
) -> Inbetweens:
    """Make ``count`` poses between two pictures of the character, which the model reads.

    Raises InputError for pictures that cannot be read or have different sizes.
    """
    _check(count, size)
    images, picture_from_crop, shape = read_pair(pictures, model.size)
    codes = model.encode(images)
    ends = apply(picture_from_crop, model.decode(codes))
    keys = Keys(Times(np.nan, 0.0, 1.0, np.nan), ends[[0, 0, 1, 1]])

    def decode(mixed: Float[np.ndarray, "B Z"], shares: Float[np.ndarray, "B"]) -> Float[np.ndarray, "B V 2"]:
        return apply(picture_from_crop, model.decode(mixed))

    tree = bone_tree_of(model.puppet)
    poses = between(tree, keys, even_shares(count), method, None, Codes(codes[0], codes[1], decode))
    vertices = np.concatenate([ends[:1], poses, ends[1:]])
    order = np.tile(np.arange(model.puppet.num_layers), (count + 2, 1))
    trust = np.ones(len(model.puppet.vertices))
    made_by = {
        "command": "inbetween", "pictures": [str(path.absolute()) for path in pictures], "count": count,
        "method": method,
    }  # fmt: skip
    posed, placed = _posed(model.puppet, vertices, order, trust, shape, size, closely, None, made_by)
    return Inbetweens(posed, placed)


def _check(count: int, size: int) -> None:
    if not 1 <= count <= MOST_COUNT:
        raise InputError(f"--count {count}: expected 1 to {MOST_COUNT} inbetweens")
    if not 16 <= size <= MOST_SIZE:
        raise InputError(f"--size {size}: expected 16 to {MOST_SIZE} pixels")


def _row_of(run: RunFolder, frame: int) -> int:
    """Find a frame in the run; raises InputError where it cannot be a key."""
    found = np.flatnonzero(run.fit.frames == frame)
    if not len(found):
        known = f"{int(run.fit.frames[0])} to {int(run.fit.frames[-1])}"
        raise InputError(f"--frames: expected two frames of the run ({known}), found {frame}")
    row = int(found[0])
    if run.fit.state[row] == "lost":
        raise InputError(f"--frames: the character is lost in frame {frame}; give one that shows it")
    return row


def _nearest(
    drawings: Drawings, vertices: Float[np.ndarray, "T V 2"]
) -> tuple[Int[np.ndarray, "T"], tuple[float, ...]]:
    """Find the drawing most like each pose, wherever it stands in the picture, and how far from it the mesh is."""
    known = drawings.vertices - drawings.vertices.mean(1, keepdims=True)
    rows = [np.linalg.norm(known - (pose - pose.mean(0)), axis=-1).mean(1) for pose in vertices]
    distance = np.stack(rows)
    best = distance.argmin(1)
    return best, tuple(distance[np.arange(len(best)), best].tolist())


def _codes_of_run(run: RunFolder, model: Model | None, rows: tuple[int, int], source: Path | None) -> Codes:
    """Read two frames of the run with the model; its vertices go to the video as the windows do."""
    if model is None:
        raise InputError("--method code: expected --model MODEL, the network that reads the drawings")
    crops = run_crops(run, source)
    images = np.concatenate([crops.images[row : row + 1] for row in rows])
    windows = crops.video_from_crop[list(rows)].astype(np.float64)
    scale = np.array(crops.size, np.float64) / np.array(model.size, np.float64)

    def decode(mixed: Float[np.ndarray, "B Z"], shares: Float[np.ndarray, "B"]) -> Float[np.ndarray, "B V 2"]:
        maps = (1.0 - shares)[:, None, None] * windows[0] + shares[:, None, None] * windows[1]
        return apply(maps, model.decode(mixed) * scale)

    codes = model.encode(images)
    return Codes(codes[0], codes[1], decode)


def _rate(run: RunFolder) -> Fraction | None:
    return None if run.times is None else run.animation.timing.rate


def _posed(
    puppet: Puppet,
    vertices: Float[np.ndarray, "T V 2"],
    order: Int[np.ndarray, "T L"],
    trust: Float[np.ndarray, "V"],
    shape: tuple[int, int],
    size: int,
    closely: bool,
    rate: Fraction | None,
    made_by: dict[str, object],
) -> tuple[Posed, Float[np.ndarray, "2 3"]]:
    """Put poses in video pixels into the picture that is drawn."""
    picture_from_video, picture = framed(vertices, shape, size, closely)
    placed = apply(picture_from_video, vertices)
    count = len(placed)
    numbers = np.arange(count)
    state: tuple[FitState, ...] = tuple("fitted" for _ in range(count))
    fit = Fit(numbers, placed, order.astype(np.int64), np.tile(trust, (count, 1)), state)
    crops = window_of_all(picture, numbers, boxes_of(placed), rate is not None)
    times = None if rate is None else (numbers, 1 / rate)
    return Posed(puppet, crops, fit, picture, times, made_by), picture_from_video
