"""Files that appear whole or not at all: write beside, flush to the disk, rename.

A folder that is being written is locked by its process (flock on the folder itself), and the lock ends with the
process however it ends: what a killed process left behind is told from what another one is writing at this moment.
A full disk, a missing permission and the like become a StoreError that says what to do.
"""

import errno
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wildpuppet.errors import StoreError

try:
    import fcntl
except ImportError:  # Windows: folders there count as abandoned by their age alone
    fcntl = None  # type: ignore[assignment]

PREFIX = ".writing-"
YOUNG_SECONDS = 60.0
"""A folder younger than this is never cleared: its writer may not have locked it yet."""
OLD_SECONDS = 7 * 24 * 3600.0
"""Where folders cannot be locked (some network disks), one older than this counts as abandoned."""

ADVICE = {
    errno.ENOSPC: "the disk is full: free some space",
    errno.EDQUOT: "your disk quota is used up: free some space",
    errno.EFBIG: "a file would be larger than the system allows: free some space or raise the limit",
    errno.EACCES: "no permission: make the folder writable",
    errno.EPERM: "no permission: make the folder writable",
    errno.EROFS: "the disk is read-only: make it writable",
    errno.ENOTDIR: "a file stands where a folder is expected: move it",
    errno.EEXIST: "a file stands where a folder is expected: move it",
    errno.ENAMETOOLONG: "the path is too long: choose a shorter one",
    errno.EIO: "the disk reports an error: check it",
}


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn what the disk refuses inside into a StoreError of one line; other OSErrors pass."""
    try:
        yield
    except OSError as error:
        number = error.errno or 0
        if number not in ADVICE:
            raise
        raise StoreError(
            f"{_shown(folder)}: cannot write ({os.strerror(number)}); {ADVICE[number]}, or choose another folder; "
            "what was finished is kept"
        ) from error


def _shown(folder: Path) -> Path:
    """Name the place that a person knows rather than the folder that is being written beside it."""
    return next((place.parent for place in (folder, *folder.parents) if place.name.startswith(PREFIX)), folder)


@contextmanager
def new_folder(parent: Path) -> Iterator[Path]:
    """Make a locked folder in ``parent`` to write into; whatever was not renamed away is removed at the end."""
    with disk_errors(parent):
        parent.mkdir(parents=True, exist_ok=True)
        folder = parent / f"{PREFIX}{os.getpid()}-{secrets.token_hex(4)}"
        folder.mkdir()
    lock = _lock(folder)
    try:
        yield folder
    finally:
        if lock is not None:
            os.close(lock)
        shutil.rmtree(folder, ignore_errors=True)


def _lock(folder: Path) -> int | None:
    """Lock a folder against ``clear_abandoned``; None where that is not possible or somebody else holds it."""
    if fcntl is None:
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def _is_abandoned(folder: Path, now: float) -> bool:
    age = now - folder.stat().st_mtime
    if age < YOUNG_SECONDS:
        return False
    lock = _lock(folder)
    if lock is not None:
        os.close(lock)
        return True
    return fcntl is None and age > OLD_SECONDS


def clear_abandoned(parent: Path) -> int:
    """Remove the folders that killed processes left in ``parent``; give how many."""
    cleared = 0
    for folder in sorted(parent.glob(f"{PREFIX}*")):
        try:
            if _is_abandoned(folder, time.time()):
                shutil.rmtree(folder)
                cleared += 1
        except FileNotFoundError:
            continue  # its writer was quicker
    return cleared


def flush(path: Path) -> None:
    """Ask the system to put a file's or a folder's bytes on the disk."""
    if path.is_dir() and os.name == "nt":
        return  # Windows cannot open folders
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text(path: Path, text: str) -> None:
    """Write a small file whole or not at all, over the one of that name."""
    with disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f"{PREFIX}{os.getpid()}-{secrets.token_hex(4)}-{path.name}")
        try:
            beside.write_text(text, encoding="utf-8")
            flush(beside)
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
