"""Write a file beside its place and rename it there when it is whole."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wildpuppet.atomic import disk_errors


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to; it becomes ``path`` when the block ends well and goes away when it does not.

    Raises StoreError, one line, for a full disk and the like. The suffix stays, since writers go by it.
    """
    with disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.stem}.part{path.suffix}")
        try:
            yield beside
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
