"""Figures as contact sheets: a row per drawing, a column per method, its name above it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet import atomic
from wildpuppet.export.lettering import write_text

Picture = UInt8[np.ndarray, "H W 3"]

TILE = 224
GAP = 4
WORDS = 22
PAPER = 255
LETTERS = (40, 40, 40)


def grid(columns: Mapping[str, Sequence[Picture | None]], tile: int = TILE) -> UInt8[np.ndarray, "h w 3"]:
    """Lay pictures out; columns may differ in length, and where a picture is missing the paper stays empty."""
    num_rows = max(len(pictures) for pictures in columns.values())
    sheet = np.full((WORDS + num_rows * (tile + GAP), len(columns) * (tile + GAP), 3), PAPER, np.uint8)
    for column, (name, pictures) in enumerate(columns.items()):
        left = column * (tile + GAP)
        write_text(sheet[:WORDS, left : left + tile], (3, 2), name, LETTERS)
        for row, picture in enumerate(pictures):
            if picture is not None:
                top = WORDS + row * (tile + GAP)
                sheet[top : top + tile, left : left + tile] = fitted(picture, tile)
    return sheet


def save_sheet(path: Path, sheet: UInt8[np.ndarray, "H W 3"]) -> None:
    """Write a sheet as PNG, whole or not at all."""
    with atomic.disk_errors(path.parent), atomic.new_folder(path.parent) as beside:
        Image.fromarray(sheet).save(beside / path.name)
        (beside / path.name).replace(path)


def fitted(picture: Picture, tile: int) -> UInt8[np.ndarray, "tile tile 3"]:
    """Scale a picture into a white square."""
    height, width = picture.shape[:2]
    scale = tile / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    kind = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    small = cv2.resize(picture, size, interpolation=kind)
    square = np.full((tile, tile, 3), PAPER, np.uint8)
    top, left = (tile - size[1]) // 2, (tile - size[0]) // 2
    square[top : top + size[1], left : left + size[0]] = small
    return square
