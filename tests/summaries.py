"""Robust summaries of values: a few numbers that move when an answer does, and hardly with the machine."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from PIL import Image

from wildpuppet.types import Images

Summary = dict[str, Any]

NUM_PROJECTIONS = 4
UNTOLD = ("path", "digest")
"""Fields that name files: they differ from place to place."""


def summary_of(value: Any) -> Summary:
    """Summarise a value of ``wildpuppet.types``, an array or a folder of files: name -> numbers or words."""
    return {name.lstrip("./") or "value": summary for name, summary in _summaries("", value)}


def _summaries(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield name, _numbers(value)
    elif isinstance(value, np.ndarray):
        yield name, value.tolist()
    elif isinstance(value, Path):
        for path in sorted(path for path in value.rglob("*") if path.is_file()):
            yield from _summaries(f"{name}/{path.relative_to(value).as_posix()}", _content(path))
    elif is_dataclass(value):
        told = {field.name: getattr(value, field.name) for field in fields(value) if field.name not in UNTOLD}
        yield from _summaries(name, told)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _summaries(f"{name}.{key}", inner)
    elif isinstance(value, tuple | list) and any(is_dataclass(inner) for inner in value):
        for index, inner in enumerate(value):
            yield from _summaries(f"{name}.{index}", inner)
    elif isinstance(value, Images) and not isinstance(value, tuple | list | str):
        yield name, _numbers(value[:])
    else:
        yield name, str(value) if isinstance(value, Fraction) else value if value is None else np.array(value).tolist()


def _content(path: Path) -> Any:
    """Read a file that a stage wrote."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return {name: arrays[name] for name in arrays.files}
    if path.suffix == ".png":
        return np.asarray(Image.open(path))
    if path.suffix == ".mp4":
        with av.open(str(path)) as container:
            return np.stack([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])
    return np.array(re.findall(r"-?\d+(?:\.\d+)?", path.read_text()), float)


def _numbers(array: np.ndarray) -> Summary:
    """Shape, mean, spread, and projections on fixed random signs: no element can change and leave them all."""
    finite = np.isfinite(array)
    values = np.where(finite, array, 0).astype(np.float64).ravel()
    mean, spread = (float(values.mean()), float(values.std())) if values.size else (0.0, 0.0)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (NUM_PROJECTIONS, values.size))
    projections = signs @ (values - mean) / max(values.size, 1) ** 0.5
    rounded = [float(f"{number:.6g}") for number in (mean, spread, *projections)]
    return {"shape": list(array.shape), "finite": int(finite.sum()), "numbers": rounded}


def differences(before: Summary, now: Summary, tolerance: float) -> list[str]:
    """Name what differs; numbers may move by ``tolerance`` times the array's spread (or its mean, where it is flat)."""
    names = sorted(before.keys() | now.keys())
    return [name for name in names if not _is_same(before.get(name), now.get(name), tolerance)]


def _is_same(before: Any, now: Any, tolerance: float) -> bool:
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return bool(before == now)
    if (before["shape"], before["finite"]) != (now["shape"], now["finite"]):
        return False
    mean, spread = before["numbers"][:2]
    allowed = tolerance * (spread or abs(mean)) + 1e-9
    return bool(np.allclose(before["numbers"], now["numbers"], rtol=0.0, atol=allowed))
