"""What a MODEL and a REFINER folder share: files that are replaced whole, and a description that is written last."""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wildpuppet import atomic
from wildpuppet.errors import InputError
from wildpuppet.store import check_format, read_json
from wildpuppet.types import Puppet

CHECKPOINT = "training.safetensors"
"""The unfinished training, beside where its result will be."""
SHOWN_LOSSES = 50
"""Losses are written as means over so many stretches of the training."""


def puppet_digest(puppet: Puppet) -> str:
    """Give the digest of a built puppet's meshes and textures.

    Hinges do not count: each run learns their places anew, and a model moves the same puppet wherever they are.
    """
    digest = hashlib.blake2b(json.dumps([puppet.names, puppet.canvas]).encode(), digest_size=20)
    for array in (puppet.vertices, puppet.triangles, puppet.layer_of_vertex, puppet.uv, puppet.atlas):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def check_only(out: Path, ours: Collection[str], kind: str, option: str = "") -> None:
    """Raise InputError when ``out`` holds something that is not of ``ours``; an empty or absent folder is fine.

    ``kind`` is what the folder is for, ``option`` ("--out ") how the person named it.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{option}{out}: expected a folder, found a file; give another one")
    others = sorted(item.name for item in out.glob("*") if item.name not in ours) if out.is_dir() else []
    others = [name for name in others if not name.startswith(atomic.PREFIX)]
    if others:
        raise InputError(f"{option}{out}: not empty and not a {kind}'s folder (found {others[0]}); give a new folder")


def is_made_from(description: Path, identity: str) -> bool:
    """Tell whether a description is there, which says that the training ``identity`` is finished."""
    return description.is_file() and read_json(description).get("identity") == identity


def read_description(path: Path, form: str, expected: str) -> Any:
    """Read a description; raises InputError where there is none, StoreError for a damaged or a newer one."""
    if not path.is_file():
        folder = path.parent
        found = f"a folder without {path.name}" if folder.is_dir() else "a file" if folder.exists() else "nothing"
        raise InputError(f"{folder}: expected {expected}, found {found}")
    found = read_json(path)
    check_format(form, found.get("schema"), path)
    return found


@contextmanager
def replaced_files(folder: Path, *stale: str) -> Iterator[Path]:
    """Give a folder to write into; its files then take their places in ``folder``, once the ``stale`` ones are gone.

    Raises StoreError where the disk refuses.
    """
    with atomic.disk_errors(folder), atomic.new_folder(folder) as beside:
        yield beside
        for name in stale:
            (folder / name).unlink(missing_ok=True)
        for path in sorted(beside.iterdir()):
            atomic.flush(path)
            path.replace(folder / path.name)


def write_description(path: Path, description: Mapping[str, Any]) -> None:
    """Write a description and take the checkpoint beside it away: the training is finished."""
    atomic.write_text(path, json.dumps(description, indent=1, sort_keys=True) + "\n")
    (path.parent / CHECKPOINT).unlink(missing_ok=True)


def in_short(losses: Mapping[str, Float[np.ndarray, "_"]]) -> dict[str, list[float]]:
    """Give the losses of a training as means over ``SHOWN_LOSSES`` stretches."""
    return {name: _means(values) for name, values in sorted(losses.items())}


def _means(values: Float[np.ndarray, "_"]) -> list[float]:
    stretches = np.array_split(values, min(SHOWN_LOSSES, max(len(values), 1)))
    return [float(f"{stretch.mean():.6g}") for stretch in stretches if len(stretch)]
