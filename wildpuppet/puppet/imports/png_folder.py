"""A folder of pictures of one size, one RGBA per part: the file names, sorted as a person would, are back to front."""

import re
from pathlib import Path

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import Rgba, open_picture, read_picture, require_canvas
from wildpuppet.puppet.imports.result import Imported, Layer, assembled

SUFFIXES = (".png", ".webp", ".tif", ".tiff")


def is_png_folder(path: Path) -> bool:
    """Say whether a folder holds pictures."""
    return path.is_dir() and bool(_pictures(path))


def read_png_folder(folder: Path) -> Imported:
    """Read a folder of part pictures.

    A number in front of a name orders the parts and is left out of the part's name where names stay apart.

    Raises:
        PuppetError: a picture has another size than the first, no alpha, or cannot be read.
    """
    paths = _pictures(folder)
    if not paths:
        raise PuppetError(f"{folder}: no picture in it; expected one RGBA PNG per part, all of one size")
    with open_picture(paths[0], str(paths[0])) as first:
        canvas = first.size
    require_canvas(canvas, len(paths), str(folder))
    layers = [Layer(name, _read(path, canvas)) for name, path in zip(_names(paths), paths, strict=True)]
    passed_over = sorted(path.name for path in folder.iterdir() if path not in paths and not path.name.startswith("."))
    notes = [f"passed over {', '.join(passed_over[:5])}"] if passed_over else []
    return assembled(canvas, layers, notes, str(folder))


def natural(name: str) -> list[tuple[int, str]]:
    """Give the key that sorts part2 before part10."""
    return [(int(piece), "") if piece.isdecimal() else (-1, piece.lower()) for piece in re.split(r"(\d{1,9})", name)]


def _pictures(folder: Path) -> list[Path]:
    found = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
    return sorted((path for path in found if not path.name.startswith(".")), key=lambda path: natural(path.stem))


def _read(path: Path, canvas: tuple[int, int]) -> Rgba:
    with open_picture(path, str(path)) as image:
        if image.size != canvas:
            found, expected = "{} x {}".format(*image.size), "{} x {}".format(*canvas)
            raise PuppetError(
                f"{path}: is {found}, the first picture is {expected}; save every part on the whole canvas (trimmed "
                "pictures do not say where they belong)"
            )
        if not image.has_transparency_data:
            raise PuppetError(f"{path}: has no alpha (mode {image.mode}); save the part with transparency around it")
    return read_picture(path, str(path))


def _names(paths: list[Path]) -> list[str]:
    plain = [re.sub(r"^\d+[\s._-]+", "", path.stem) for path in paths]
    return plain if len(set(plain)) == len(plain) and all(plain) else [path.stem for path in paths]
