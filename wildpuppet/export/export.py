"""Write one animation in one format into OUT/FORMAT, whole or not at all."""

import json
from pathlib import Path
from typing import Any

from wildpuppet import atomic
from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation
from wildpuppet.export.formats import Format
from wildpuppet.export.manifest import MANIFEST, SCHEMA, digests, write_manifest
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress, silent


def check_out(out: Path) -> None:
    """Raise InputError when ``out`` holds anything but exports of ours; an empty or absent folder is fine."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: expected a folder, found a file; give another one")
    for item in sorted(out.iterdir()) if out.is_dir() else ():
        if not item.name.startswith(atomic.PREFIX) and _manifest(item) is None:
            raise InputError(f"--out {out}: holds other files ({item.name}); give a new or an empty folder")


def check_unedited(folder: Path) -> None:
    """Raise InputError when an earlier export in ``folder`` was changed by hand: it must not be overwritten."""
    if not folder.is_dir():
        return
    written = (_manifest(folder) or {}).get("files", {})
    changed = sorted(name for name, digest in digests(folder).items() if written.get(name) != digest)
    if changed:
        raise InputError(f"{folder}: {changed[0]} was changed or added since it was exported; move the folder away")


def export(
    animation: Animation,
    format_to: Format,
    out: Path,
    options: Options | None = None,
    progress: Progress = silent,
) -> Path:
    """Write OUT/FORMAT with its manifest.json; an unchanged earlier export there is replaced. Gives the folder.

    Raises InputError for an ``out`` with other files, for an earlier export that was changed by hand, for a missing
    extra and for an animation without frames; StoreError where the disk refuses.
    """
    write, target = format_to.writer(), out / format_to.name
    if not len(animation):
        raise InputError(f"{animation.name}: expected a run with frames, found none; run it on a longer range")
    check_out(out)
    check_unedited(target)
    with atomic.disk_errors(out), atomic.new_folder(out) as beside:
        atomic.clear_abandoned(out)
        folder = beside / format_to.name
        folder.mkdir()
        manifest = write(animation, folder, options or Options(), progress)
        write_manifest(folder, format_to.name, animation, manifest)
        if target.exists():
            target.rename(beside / "replaced")
        folder.rename(target)
    return target


def _manifest(folder: Path) -> dict[str, Any] | None:
    """Read the manifest of an export; None where ``folder`` is none."""
    try:
        tree = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return tree if isinstance(tree, dict) and tree.get("schema") == SCHEMA else None
