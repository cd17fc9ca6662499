"""A run folder made of poses that nobody drew: `open_run`, `export` and `points` work on it like on any other.

    carry/, meshes.npz, atlas.png, run.json       as in a run
    preview.mp4, sheet.png, frames/               as far as the maker gives them

``run.json``'s request says what it was made of under ``made_by``. There is no video behind it, so that what reads
pictures anew (`train`, `refine`, `paint --over original`) refuses it.
"""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from wildpuppet import disk
from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation, animation_of
from wildpuppet.export.meshes import write_meshes
from wildpuppet.runs import CARRY, MESHES, check_out, write_run
from wildpuppet.store import read_json
from wildpuppet.types import Clip, Crops, Fit, Puppet, TrackState

Made = Callable[[Path], None]


@dataclass(frozen=True, eq=False)
class Posed:
    """A puppet in motion in a picture of ``size``; ``times`` are the frames' pts and their time base, if they have any.

    ``made_by`` are plain values that say what it was made of, beginning with ``command``.
    """

    puppet: Puppet
    crops: Crops
    fit: Fit
    size: tuple[int, int]
    times: tuple[Int[np.ndarray, "T"], Fraction] | None
    made_by: Mapping[str, Any]

    @property
    def animation(self) -> Animation:
        """The puppet in motion, as exports are given it."""
        return animation_of(self.puppet, self.crops, self.fit, self.size, self.times, str(self.made_by["command"]))


def check_made(out: Path, command: str) -> None:
    """Raise InputError when ``out`` holds anything but an earlier result of this command."""
    check_out(out)
    path = out / "run.json"
    if path.is_file():
        tree = read_json(path)
        made_by = (tree.get("request") or {}).get("made_by") or {}
        if tree.get("is_finished") and made_by.get("command") != command:
            raise InputError(f"--out {out}: holds a run that `wildpuppet {command}` did not make; give another folder")


def write_posed(out: Path, posed: Posed, write_more: Made | None = None) -> Path:
    """Write the folder, whole or not at all; ``write_more`` adds files to the folder that it is given."""
    check_made(out, str(posed.made_by["command"]))
    with tempfile.TemporaryDirectory(prefix="wildpuppet-") as place:
        folder = Path(place)
        (folder / CARRY).mkdir()
        disk.save_puppet(posed.puppet, folder / CARRY)
        disk.save_windows(posed.crops, folder / CARRY)
        disk.save_fit(posed.fit, folder / CARRY)
        write_meshes(folder / MESHES, posed.puppet, posed.crops, posed.fit, _clip(posed))
        if write_more is not None:
            write_more(folder)
        files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
        write_run(out, files, _description(posed), {"schema": "wildpuppet.timings/1"})
    return out


def window_of_all(size: tuple[int, int], frames: Int[np.ndarray, "T"], boxes: np.ndarray, is_ordered: bool) -> Crops:
    """Give windows that all show the whole picture."""
    count = len(frames)
    whole = np.repeat(np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]), count, 0)
    zeros = np.zeros(count, np.int64)
    numbers = np.arange(count)
    state: tuple[TrackState, ...] = tuple("followed" for _ in range(count))
    return Crops(frames, size, whole, disk.NoPictures(count), boxes, numbers, zeros, state, None, is_ordered)


def boxes_of(vertices: np.ndarray) -> np.ndarray:
    """Bound each frame's vertices: x, y, w, h."""
    low, high = vertices.min(1), vertices.max(1)
    return np.concatenate([low, high - low], 1)


def _clip(posed: Posed) -> Clip | None:
    """A clip that holds nothing but the frames' times."""
    if posed.times is None:
        return None
    pts = np.zeros(int(posed.fit.frames.max()) + 1, np.int64)
    pts[posed.fit.frames] = posed.times[0]
    return Clip(Path(), "", posed.size, pts, posed.times[1])


def _description(posed: Posed) -> dict[str, Any]:
    """What run.json says beside the files."""
    fit = posed.fit
    return {
        "request": {"source": "", "puppet": None, "box_video": None, "made_by": dict(posed.made_by)},
        "size": list(posed.size),
        "names": [],
        "test": [],
        "stages": [],
        "worth_a_look": [],
        "frames": [int(frame) for frame in fit.frames],
        "state": list(fit.state),
        "states": {state: fit.state.count(state) for state in sorted(set(fit.state))},
        "confidence": [round(float(value), 4) for value in fit.confidence.mean(axis=1)],
        "losses": {},
    }
