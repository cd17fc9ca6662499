"""Write an imported puppet into a folder that is new or empty, and say what it is."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from wildpuppet.errors import InputError

if TYPE_CHECKING:
    from wildpuppet.puppet.imports.result import Imported


def require_room(out: Path) -> None:
    """Refuse, before any work, an --out that is not new or empty."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        what = "is a file" if not out.is_dir() else "is not empty"
        raise InputError(f"--out {out}: {what}; choose a new folder")


def written(imported: "Imported", out: Path) -> None:
    """Write the puppet folder whole."""
    from wildpuppet.puppet.folder import write_cutout

    write_cutout(imported.cutout, out, overwrite=out.is_dir())


def tell(imported: "Imported", out: Path) -> None:
    """Say what was read and what the person should look at."""
    cutout = imported.cutout
    for note in imported.notes:
        sys.stdout.write(f"{note}\n")
    width, height = cutout.canvas
    names = ", ".join(part.name for part in cutout.parts)
    sys.stdout.write(f"{out}: {len(cutout.parts)} parts on {width} x {height}, back to front: {names}\n")
    sys.stdout.write(f"{len(cutout.joints)} joints; now run wildpuppet puppet check {out}\n")
