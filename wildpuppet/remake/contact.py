"""What shows inbetweens to a person: frames with alpha, a film, and a sheet with the nearest drawing beside each."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet.export.draw import Painter
from wildpuppet.export.lettering import write_text
from wildpuppet.export.png import COMPRESSION, numbered
from wildpuppet.export.sheet import BACKGROUND, TILE, WORDS, grid, spread
from wildpuppet.export.source import over_white
from wildpuppet.machine import Progress
from wildpuppet.remake.inbetween import Inbetweens
from wildpuppet.video.write import write_preview

Picture = UInt8[np.ndarray, "H W 3"]
Finish = Callable[[int, UInt8[np.ndarray, "H W 4"]], UInt8[np.ndarray, "H W 4"]]
"""Turns a rendered frame (its number, straight RGBA) into a finished one."""

FRAMES, STEM = "frames", "inbetween"
MOST_CELLS = 24
AROUND = 1.12


def write_pictures(
    folder: Path,
    found: Inbetweens,
    progress: Progress,
    picture_of: Callable[[int], Picture] | None = None,
    finish: Finish | None = None,
) -> None:
    """Write frames/inbetween.NNNNN.png (0 and the last are the keys), preview.mp4 and sheet.png.

    ``picture_of`` gives the run's picture of a frame for the sheet; the frames are rendered once and read back.
    """
    animation = found.posed.animation
    painter, stem = Painter(animation), folder / FRAMES / STEM
    stem.parent.mkdir()
    for t, rendered in enumerate(painter.pictures()):
        picture = rendered if finish is None else finish(t, rendered)
        Image.fromarray(picture).save(numbered(stem, t), compress_level=COMPRESSION)
        progress(t + 1, len(animation))
    paths = [numbered(stem, t) for t in range(len(animation))]
    timing = animation.timing
    write_preview(folder / "preview.mp4", _over_white(paths), timing.pts, timing.time_base)
    Image.fromarray(contact_sheet(found, paths, picture_of)).save(folder / "sheet.png")


def contact_sheet(found: Inbetweens, paths: list[Path], picture_of: Callable[[int], Picture] | None) -> Picture:
    """Draw every pose, or as many as fit evenly spaced, each beside the run's drawing that is most like it."""
    animation = found.posed.animation
    cells = []
    for t in spread(len(animation), MOST_CELLS):
        window = _window(animation.vertices(t))
        tiles = [_tile(over_white(_read(paths[t])), window)]
        words = _caption(t, len(animation))
        if picture_of is not None and found.nearest:
            frame = found.nearest[t]
            words += f"     nearest: {frame}, {found.away[t]:.1f} px away"
            tiles.append(_near(found, picture_of(frame), t))
        strip = np.full((WORDS, TILE * len(tiles), 3), BACKGROUND, np.uint8)
        write_text(strip, (4, 1), words)
        cells.append(np.concatenate([strip, np.concatenate(tiles, 1)]))
    return grid(cells)


def _caption(t: int, count: int) -> str:
    return "first" if t == 0 else "last" if t == count - 1 else f"inbetween {t}"


def _near(found: Inbetweens, picture: Picture, t: int) -> UInt8[np.ndarray, "side side 3"]:
    """Cut the nearest drawing out of its picture, at the scale of the pose beside it."""
    assert found.nearest_vertices is not None
    scale = float(found.picture_from_video[0, 0])
    larger = float(np.ptp(found.posed.fit.vertices_crop[t], axis=0).max()) / scale
    return _tile(picture, _window(found.nearest_vertices[t], larger))


def _window(vertices: np.ndarray, larger: float | None = None) -> tuple[float, float, float]:
    low, high = vertices.min(0), vertices.max(0)
    side = AROUND * (float((high - low).max()) if larger is None else larger)
    left, top = ((low + high - side) / 2.0).tolist()
    return left, top, side


def _tile(picture: Picture, window: tuple[float, float, float]) -> UInt8[np.ndarray, "side side 3"]:
    """Resample a square of a picture to a tile; white beyond it."""
    left, top, side = window
    scale = side / TILE
    shrunk = picture
    while scale > 2.0:  # averages before it resamples, so that thin lines stay
        shrunk = cv2.resize(shrunk, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        left, top, scale = left / 2.0, top / 2.0, scale / 2.0
    offset = 0.5 * scale - 0.5
    matrix = np.array([[scale, 0.0, left + offset], [0.0, scale, top + offset]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    white = (255, 255, 255)
    return np.asarray(cv2.warpAffine(shrunk, matrix, (TILE, TILE), flags=flags, borderValue=white), np.uint8)


def _over_white(paths: list[Path]) -> Iterator[Picture]:
    for path in paths:
        yield over_white(_read(path))


def _read(path: Path) -> UInt8[np.ndarray, "H W 4"]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGBA"))
