"""manifest.json: what an export holds, where its zero is, what its format could not hold, and how exact it is.

A writer fills in ``Manifest``; everything that is the same for all formats (times, order, shots, visibility, digests)
is added here, so that nothing is lost even where the format has no place for it.
"""

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wildpuppet.export.animation import Animation

MANIFEST = "manifest.json"
SCHEMA = "wildpuppet.export/1"


@dataclass(frozen=True)
class PositionError:
    """Distance in video pixels between our vertices and those read back from the files."""

    largest: float
    percentile_99_9: float
    read_by: str
    """What read the files back."""


@dataclass(frozen=True)
class Manifest:
    """What a writer says of its files.

    ``origin`` and ``axes`` are words ("top left corner of the picture", "x right, y up"). ``units_per_pixel`` is the
    format's length of one video pixel. ``first_frame`` is the number that the first exported frame has in the files.
    ``left_out`` says in words what the format cannot hold of this very animation.
    """

    origin: str
    axes: str
    first_frame: int
    units_per_pixel: float = 1.0
    left_out: tuple[str, ...] = ()
    error: PositionError | None = None
    """None where positions are not in the files or exact reading is not cheap."""


def position_error(distances: Iterable[Float[np.ndarray, "_"]], read_by: str) -> PositionError:
    """Sum up distances in pixels, given frame by frame."""
    joined = np.concatenate([np.zeros(1, np.float32), *(np.asarray(some, np.float32).ravel() for some in distances)])
    largest, most = float(joined.max()), float(np.percentile(joined, 99.9))
    return PositionError(float(f"{largest:.4g}"), float(f"{most:.4g}"), read_by)


def rounding_error(
    animation: Animation, rounded: Callable[[Float[np.ndarray, "V 2"]], Float[np.ndarray, "V 2"]]
) -> PositionError:
    """Measure what a format's ``rounded`` takes from places in the picture, over all vertices and frames."""
    moved = (rounded(frame.vertices) - frame.vertices for frame in animation)
    return position_error((np.linalg.norm(each, axis=1) for each in moved), "the numbers as written")


def write_manifest(folder: Path, format_name: str, animation: Animation, manifest: Manifest) -> None:
    """Write manifest.json beside the files that are in ``folder`` now."""
    said = asdict(manifest)
    if not animation.is_ordered:
        said["left_out"] = ["times: drawings have none, these are made up", *said["left_out"]]
    tree = {"schema": SCHEMA, "format": format_name, **_facts(animation), **said, "files": digests(folder)}
    (folder / MANIFEST).write_text(json.dumps(tree, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def digests(folder: Path) -> dict[str, str]:
    """Give name and digest of every file under a folder but the manifest."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    named = {path.relative_to(folder).as_posix(): path for path in files}
    return {name: _digest(path) for name, path in named.items() if name != MANIFEST}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=20)).hexdigest()


def _facts(animation: Animation) -> dict[str, Any]:
    """What is true of the animation whatever the format."""
    timing, names = animation.timing, animation.puppet.names
    return {
        "name": animation.name,
        "frames": [int(number) for number in animation.frames],
        "video_size": list(animation.size),
        "rate": str(timing.rate),
        "is_variable_rate": timing.is_variable,
        "pts": [int(pts) for pts in timing.pts],
        "time_base": str(timing.time_base),
        "parts": list(names),
        "order_back_to_front": [
            {"frame": int(animation.frames[t]), "parts": [names[layer] for layer in animation.order[t]]}
            for t in animation.order_changes
        ],
        "shots_start_at": [int(animation.frames[t]) for t in animation.shot_starts],
        "confidence": [round(float(sure), 4) for sure in animation.confidence.mean(1)],
        "doubtful_frames": [
            int(number) for number, state in zip(animation.frames, animation.state, strict=True) if state == "doubtful"
        ],
        "hidden_frames": [int(number) for number in animation.frames[~animation.is_visible]],
        "held_frames": [
            int(number) for number, state in zip(animation.frames, animation.state, strict=True) if state == "held"
        ],
    }
