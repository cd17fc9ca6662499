"""The folder that a run leaves (OUT): what lies where, written so that a killed run leaves whole files only.

    run.json       what was asked for, the key of every result, states and losses by frame, the frames most worth a
                   look, a digest of every file
    timings.json   when, where and how long: all that may differ between two runs with the same answer
    exposure.csv, meshes.npz, preview.mp4, sheet.png, meshes/      see ``export/``
    carry/         puppet.npz, crops.npz, fit.npz: enough to carry points and flow when the store is gone
    puppet/        the automatic puppet, when none was given

An unbroken run and one that was killed and run again give byte-identical files, so run.json holds no times, no
store path and nothing about the machine; those stand in timings.json, which is the one file left out of that promise.
"""

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from wildpuppet import atomic, disk
from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation, animation_of
from wildpuppet.store import check_format, digest_of_file, read_json
from wildpuppet.types import Crops, Fit, Puppet

RUN = "run.json"
TIMINGS = "timings.json"
FORMAT = "wildpuppet.run"
SCHEMA = f"{FORMAT}/1"
MESHES = "meshes.npz"
MESHES_SCHEMA = "wildpuppet.meshes/1"
CARRY = "carry"
PUPPET = "puppet"


@dataclass(frozen=True)
class RunFolder:
    """A run that is done, read from its own folder."""

    folder: Path

    @cached_property
    def run(self) -> dict[str, Any]:
        """What run.json says."""
        return read_run(self.folder)

    @cached_property
    def puppet(self) -> Puppet:
        """The built puppet."""
        return disk.load_puppet(self.folder / CARRY)

    @cached_property
    def crops(self) -> Crops:
        """The windows, without pictures."""
        return disk.load_crops(self.folder / CARRY)

    @cached_property
    def fit(self) -> Fit:
        """The fitted puppet in every frame."""
        return disk.load_fit(self.folder / CARRY)

    @cached_property
    def times(self) -> tuple[Int[np.ndarray, "T"], Fraction] | None:
        """The frames' pts and their time base; None for drawings, which have no times."""
        arrays = disk.read_arrays(self.folder / MESHES, MESHES_SCHEMA)
        if "pts" not in arrays:
            return None
        return arrays["pts"], Fraction(*disk.whole_numbers(arrays["time_base"]))

    @cached_property
    def animation(self) -> Animation:
        """The puppet in motion, as exports are given it."""
        name = self.folder.resolve().name or "puppet"
        return animation_of(self.puppet, self.crops, self.fit, self.size, self.times, name)

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) of the video or of the drawings' canvas."""
        width, height = self.run["size"]
        return int(width), int(height)


def read_run(folder: Path) -> dict[str, Any]:
    """Read a run's run.json; raises InputError where there is none or the run was stopped before its end."""
    path = folder / RUN
    if not path.is_file():
        found = "a folder without run.json" if folder.is_dir() else "a file" if folder.exists() else "nothing"
        raise InputError(f"{folder}: expected the OUT folder of a run, found {found}")
    run: dict[str, Any] = read_json(path)
    check_format(FORMAT, run.get("schema"), path)
    if not run.get("is_finished"):
        raise InputError(f"{folder}: the run that writes this folder has not finished; run it again to resume")
    return run


def check_out(out: Path) -> None:
    """Raise InputError when ``out`` holds something that is not a run of ours; an empty or absent folder is fine.

    Raises StoreError when a newer version wrote the run that it holds.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: expected a folder, found a file; give another one")
    if not out.is_dir():
        return
    is_used = any(not item.name.startswith(atomic.PREFIX) for item in out.iterdir())
    if (out / RUN).is_file():  # asked last: another process may be writing the folder, run.json first
        check_format(FORMAT, read_json(out / RUN).get("schema"), out / RUN)
    elif is_used:
        raise InputError(f"--out {out}: not empty and not a run's folder (no run.json); give a new or an empty folder")


def check_puppet_unedited(out: Path) -> None:
    """Raise InputError when the automatic puppet in ``out`` was changed by hand: it must not be overwritten."""
    written = _written(out)
    for path in sorted((out / PUPPET).rglob("*")):
        name = path.relative_to(out).as_posix()
        if path.is_file() and path.name != "overlay.png" and written.get(name) != digest_of_file(path):
            raise InputError(
                f"{out / PUPPET}: {path.name} was changed since the automatic puppet was written; "
                f"use it with --puppet {out / PUPPET}, or move it away to have a new one made"
            )


def _written(out: Path) -> dict[str, str]:
    """Names and digests of the files that the last run wrote into ``out``."""
    try:
        files = read_json(out / RUN).get("files", {})
    except FileNotFoundError:
        return {}
    return dict(files)


def _plain(tree: Mapping[str, Any]) -> str:
    return json.dumps(tree, indent=1, sort_keys=True, allow_nan=False) + "\n"


def write_run(out: Path, sources: Mapping[str, Path], run: Mapping[str, Any], timings: Mapping[str, Any]) -> None:
    """Copy ``sources`` (name in OUT -> file) into ``out`` and write run.json last.

    Each file is replaced in one step; files of the previous run that this one does not have go; what else lies there
    stays. A folder that is new is marked as ours first, so that a run killed here can be run again.
    """
    check_out(out)
    before = _written(out)
    with atomic.disk_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        if not (out / RUN).exists():
            atomic.write_text(out / RUN, _plain({"schema": SCHEMA, "is_finished": False}))
        atomic.clear_abandoned(out)
        digests = _place(out, sources)
        for name in _outdated(before, digests):
            _remove_ours(out, name, before[name])
        atomic.write_text(out / TIMINGS, _plain(timings))
        atomic.write_text(out / RUN, _plain({"schema": SCHEMA, "is_finished": True, "files": digests, **run}))


def _outdated(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Name the files of the previous run that this one does not have.

    An automatic puppet is left where it is by a run that made none: it may be the very puppet that was given.
    """
    made_puppet = any(name.startswith(f"{PUPPET}/") for name in now)
    return [name for name in sorted(before.keys() - now.keys()) if made_puppet or not name.startswith(f"{PUPPET}/")]


def _place(out: Path, sources: Mapping[str, Path]) -> dict[str, str]:
    """Copy all files beside, then rename them one by one; give their digests."""
    with atomic.new_folder(out) as beside:
        for name, source in sources.items():
            copy = beside / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)
            atomic.flush(copy)
        digests = {name: digest_of_file(beside / name) for name in sorted(sources)}
        for name in sorted(sources):
            target = out / name
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(beside / name, target)  # noqa: PTH105 says what it does
    return digests


def _remove_ours(out: Path, name: str, digest: str) -> None:
    """Remove a file of the previous run unless somebody changed it, and its folder when that is empty then."""
    path = out / name
    if not path.is_file() or digest_of_file(path) != digest:
        return
    path.unlink()
    for folder in path.parents:
        if folder == out or any(folder.iterdir()):
            return
        folder.rmdir()
