"""The contact sheet: a whole run on one picture that a person can judge in one look.

Evenly spaced frames cut out around the character, each as source, wireframe and the puppet drawn again, with frame
number, state, loss and confidence; above them the parts' colours; under them confidence and loss of every frame.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Float

from wildpuppet.export.chart import draw_chart
from wildpuppet.export.lettering import text_width, write_text
from wildpuppet.export.meshes import vertices_video
from wildpuppet.export.overlay import Overlay, Picture, dimmed
from wildpuppet.export.palette import STATE_COLOURS, colour_of
from wildpuppet.export.preview import caption, typical_scale
from wildpuppet.geometry.affine import apply, scale_and_shift
from wildpuppet.types import Crops, Fit, Puppet

Window = tuple[int, int, int]
"""Left, top and side of a square in whole video pixels."""

TILE = 240
"""Side of each of a cell's three pictures."""
FINE = 2 * TILE
"""Side at which they are drawn before they shrink, so that lines are thin and smooth."""
CELL_COLUMNS, MOST_CELLS = 3, 18
GAP = 6
WORDS = 20
BACKGROUND = 28
AROUND = 1.15
"""Side of the square cut out, per larger side of the character's box."""


def sheet(source_of: Callable[[int], Picture], puppet: Puppet, crops: Crops, fit: Fit) -> Picture:
    """Draw the sheet. ``source_of`` gives the source picture of a clip frame number, asked in rising order."""
    placed = vertices_video(crops, fit)
    chosen = spread(len(fit.frames), MOST_CELLS)
    windows = {index: character_window(crops, placed, fit, index) for index in chosen}
    zoom = float(np.median([FINE / side for _, _, side in windows.values()]))
    overlay = Overlay(puppet, zoom * typical_scale(puppet, placed, fit))
    cells = [
        _cell(source_of(int(fit.frames[index])), windows[index], placed[index], fit, index, overlay) for index in chosen
    ]
    body = grid(cells)
    chart = draw_chart(fit, chosen, body.shape[1])
    return np.concatenate([_legend(puppet, body.shape[1]), body, chart])


def spread(num_frames: int, most: int) -> list[int]:
    """Choose up to ``most`` indices, evenly spaced, first and last included."""
    return sorted({round(place) for place in np.linspace(0, num_frames - 1, min(most, num_frames)).tolist()})


def character_window(crops: Crops, placed: Float[np.ndarray, "T V 2"], fit: Fit, index: int) -> Window:
    """Choose the square to cut out of the video: around the box, and the puppet unless it ran away."""
    x, y, w, h = crops.box_crop[index].tolist()
    low, high = apply(crops.video_from_crop[index], np.array([[x, y], [x + w, y + h]]))
    side = max(float((high - low).max()), 8.0)
    if fit.state[index] != "lost":
        reach = side / 2.0
        low = np.minimum(low, np.maximum(placed[index].min(0), low - reach))
        high = np.maximum(high, np.minimum(placed[index].max(0), high + reach))
    length = int(np.ceil(max(side * AROUND, float((high - low).max()) * 1.05)))
    left, top = np.floor((low + high - length) / 2.0).astype(int).tolist()
    return left, top, length


def _cell(
    source: Picture,
    window: Window,
    vertices: Float[np.ndarray, "V 2"],
    fit: Fit,
    index: int,
    overlay: Overlay,
) -> Picture:
    tile_from_video = _tile_from_video(window)
    tile = _cut(source, window)
    if fit.state[index] == "lost":
        drawn = [tile, tile, dimmed(tile)]
    else:
        inside = apply(tile_from_video, vertices)
        order = fit.order[index]
        drawn = [tile, overlay.wireframe(tile, inside, order), overlay.redrawn(tile, inside, order)]
    words = np.full((WORDS, 3 * TILE, 3), BACKGROUND, np.uint8)
    words[4:16, 2:14] = STATE_COLOURS[fit.state[index]]
    write_text(words, (20, 1), caption(fit, index))
    tiles = [cv2.resize(picture, (TILE, TILE), interpolation=cv2.INTER_AREA) for picture in drawn]
    return np.concatenate([words, np.concatenate(tiles, 1)])


def _tile_from_video(window: Window) -> Float[np.ndarray, "2 3"]:
    left, top, side = window
    scale = FINE / side
    return scale_and_shift(scale, (-left * scale, -top * scale))


def _cut(source: Picture, window: Window) -> Picture:
    """Cut a window to a fine tile; dark beyond the picture."""
    left, top, side = window
    height, width = source.shape[:2]
    cut = np.full((side, side, 3), BACKGROUND, np.uint8)
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + side, width), min(top + side, height)
    if x1 > x0 and y1 > y0:
        cut[y0 - top : y1 - top, x0 - left : x1 - left] = source[y0:y1, x0:x1]
    kind = cv2.INTER_AREA if side > FINE else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(cut, (FINE, FINE), interpolation=kind))


def grid(cells: Sequence[Picture]) -> Picture:
    """Lay cells of one size out in rows of ``CELL_COLUMNS``."""
    columns = min(CELL_COLUMNS, len(cells))
    rows = -(-len(cells) // columns)
    height, width = (cells[0].shape[axis] + GAP for axis in range(2))
    sheet = np.full((rows * height, columns * width, 3), BACKGROUND, np.uint8)
    for number, cell in enumerate(cells):
        y, x = number // columns * height, number % columns * width
        sheet[y : y + cell.shape[0], x : x + cell.shape[1]] = cell
    return sheet


def _legend(puppet: Puppet, width: int) -> Picture:
    """Write the parts' names in their colours, back to front, on as many lines as they need."""
    places, x, y = [], 4, 2
    for name in puppet.names:
        advance = text_width(name) + 34
        if x > 4 and x + advance > width:
            x, y = 4, y + WORDS
        places.append((x, y))
        x += advance
    legend = np.full((y + WORDS + 4, width, 3), BACKGROUND, np.uint8)
    for layer, (name, (x, y)) in enumerate(zip(puppet.names, places, strict=True)):
        legend[y + 3 : y + 15, x : x + 12] = colour_of(layer)
        write_text(legend, (x + 18, y), name)
    return legend
