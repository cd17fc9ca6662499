"""What the two video writers share: a file that appears whole or not at all, and the same bytes every time."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import av
from av.container import OutputContainer

from wildpuppet.atomic import PREFIX, disk_errors


@contextmanager
def written_beside(path: Path, container_format: str, **options: str) -> Iterator[OutputContainer]:
    """Open a video file for writing beside ``path`` and rename it into place when the block ends without an error.

    No time, version or random number gets into the file. A full disk and the like raise StoreError.
    """
    beside = path.with_name(f"{PREFIX}{os.getpid()}-{secrets.token_hex(4)}-{path.name}")
    with disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with av.open(
                f"file:{beside}", "w", format=container_format, options={"fflags": "+bitexact", **options}
            ) as container:
                yield container
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
