"""Point lists that people hand us (csv) and carried points on disk (npz)."""

import csv
import math
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import InputError, StoreError
from wildpuppet.types import PointTracks


def read_points(path: Path) -> tuple[Float[np.ndarray, "N 2"], tuple[str | None, ...]]:
    """Read a csv of ``x,y[,part]`` rows, with or without that line on top; parts left empty come back as None.

    Raises InputError that names the line of the first row that cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else f"one that cannot be read ({error})"
        raise InputError(f"{path}: expected a csv file of x,y[,part] rows, found {found}") from None
    positions: list[tuple[float, float]] = []
    parts: list[str | None] = []
    rows = csv.reader(text.splitlines())
    for row in rows:
        cells = [cell.strip() for cell in row]
        if not any(cells) or (not positions and [cell.lower() for cell in cells[:2]] == ["x", "y"]):
            continue
        positions.append(_position(cells, path, rows.line_num))
        parts.append((cells[2] or None) if len(cells) == 3 else None)
    if not positions:
        raise InputError(f"{path}: expected rows of x,y[,part], found none")
    return np.array(positions, np.float64), tuple(parts)


def _position(cells: list[str], path: Path, line: int) -> tuple[float, float]:
    complaint = f"{path}, line {line}: expected x,y or x,y,part with x and y in pixels, found {','.join(cells)!r}"
    if len(cells) not in (2, 3):
        raise InputError(complaint)
    try:
        x, y = float(cells[0]), float(cells[1])
    except ValueError:
        raise InputError(complaint) from None
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(complaint)
    return x, y


def write_tracks(path: Path, tracks: PointTracks) -> None:
    """Write points (T, N, 2) f32, visible (T, N) bool, confidence (T, N) f32 and frames (T,) i64 as npz.

    Written beside and renamed into place; raises StoreError where that fails.
    """
    beside = path.with_name(path.name + ".part")
    arrays = {
        "points": tracks.points_video.astype(np.float32),
        "visible": tracks.visible.astype(bool),
        "confidence": tracks.confidence.astype(np.float32),
        "frames": tracks.frames.astype(np.int64),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        beside.replace(path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise StoreError(f"{path}: carried points cannot be written ({error.strerror or error})") from None


def read_tracks(path: Path) -> PointTracks:
    """Read what ``write_tracks`` wrote; raises InputError where the file is something else."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = [stored[name] for name in ("frames", "points", "visible", "confidence")]
    except (OSError, EOFError, KeyError, ValueError, BadZipFile) as error:
        raise InputError(f"{path}: expected carried points (npz with points, visible, frames); {error}") from None
    return PointTracks(*arrays)
