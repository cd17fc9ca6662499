"""Read a folder of drawings, the paper's own case: no time, one canvas, one picture per file, in natural order."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageOps, UnidentifiedImageError

from wildpuppet.errors import InputError
from wildpuppet.video.backdrop import cut_out

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".webp"})


@dataclass(frozen=True)
class Drawings:
    """The drawings as a stack that is read a slice at a time; the files are read anew each time."""

    paths: tuple[Path, ...]
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.paths)

    def __iter__(self) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
        return map(read_drawing, self.paths)

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        width, height = self.size
        images = [read_drawing(path) for path in self.paths[index]]
        return np.stack(images) if images else np.zeros((0, height, width, 4), np.uint8)


def read_drawings(folder: Path) -> tuple[tuple[str, ...], Drawings]:
    """List a folder's PNG, JPEG and WebP files: (file names in natural order, their images as straight RGBA).

    ``2.png`` comes before ``10.png``. A picture with transparency keeps it as its matte; one without is cut out of its
    backdrop where the border has one colour, and is all character where not. Raises InputError, one clear line, when
    there is no such folder, no picture in it, one that cannot be read, or one of another size than the rest.
    """
    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing there"
        raise InputError(f"{folder}: expected a folder of drawings, found {found}; check the path")
    shown = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith("."))
    paths = tuple(sorted(shown, key=natural_order))
    if not paths:
        raise InputError(f"{folder}: expected PNG, JPEG or WebP files, found none; put the drawings there, one a file")
    return tuple(path.name for path in paths), Drawings(paths, _common_size(paths))


def natural_order(path: Path) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """Give a sorting key that orders the numbers in file names by value."""
    pieces = re.findall(r"\d+|\D+", path.name.lower())
    return tuple((0, int(piece), "") if piece.isdecimal() else (1, 0, piece) for piece in pieces), path.name


def read_drawing(path: Path) -> UInt8[np.ndarray, "H W 4"]:
    """Read one drawing as straight RGBA, its transparency or its cut-out as the matte."""
    with _opened(path) as image:
        try:
            rgba = np.asarray(_eight_bits(ImageOps.exif_transpose(image)).convert("RGBA"))
        except (OSError, SyntaxError, ValueError) as error:
            raise _unreadable(path, str(error)) from None
    return rgba if rgba[..., 3].min() < 255 else cut_out(rgba[..., :3])


def _eight_bits(image: Image.Image) -> Image.Image:
    """Bring 16-bit grey to 8 bits; Pillow would clip it."""
    if image.mode not in ("I", "I;16", "I;16B", "I;16L", "F"):
        return image
    values = np.asarray(image, np.float64)
    return Image.fromarray(np.clip(values / 257.0, 0, 255).round().astype(np.uint8))


def _common_size(paths: tuple[Path, ...]) -> tuple[int, int]:
    sizes = [_upright_size(path) for path in paths]
    (common, number) = Counter(sizes).most_common(1)[0]
    for path, size in zip(paths, sizes, strict=True):
        if size != common:
            raise InputError(
                f"{path}: expected {common[0]}x{common[1]} pixels as in {number} of {len(paths)} drawings, "
                f"found {size[0]}x{size[1]}; give all drawings one canvas"
            )
    return common


def _upright_size(path: Path) -> tuple[int, int]:
    with _opened(path) as image:
        is_turned = image.getexif().get(0x0112, 1) in (5, 6, 7, 8)
        return image.size[::-1] if is_turned else image.size


def _opened(path: Path) -> Image.Image:
    try:
        return Image.open(path)
    except UnidentifiedImageError:
        raise _unreadable(path, "not a picture") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise _unreadable(path, str(error)) from None


def _unreadable(path: Path, reason: str) -> InputError:
    line = " ".join(reason.split())
    return InputError(
        f"{path}: expected a picture, found one that cannot be read ({line}); save it again or take it out"
    )
