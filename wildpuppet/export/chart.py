"""A strip of curves over a run's frames: confidence, loss and state."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float

from wildpuppet.export.lettering import write_text
from wildpuppet.export.overlay import Picture
from wildpuppet.export.palette import STATE_COLOURS
from wildpuppet.export.preview import loss_name
from wildpuppet.types import Fit

ROWS = 150
LEFT, RIGHT, TOP, BOTTOM = 16, 16, 26, 34
CONFIDENCE, LOSS = (86, 180, 233), (230, 159, 0)


def draw_chart(fit: Fit, marked: Sequence[int], width: int) -> Picture:
    """Draw confidence (0..1) and loss (lowest to highest) of every frame over a band of states.

    ``marked`` frames (the sheet's cells) get a line and their number.
    """
    chart = np.full((ROWS, width, 3), 20, np.uint8)
    columns = np.linspace(LEFT, width - RIGHT, len(fit.frames)) if len(fit.frames) > 1 else np.array([float(LEFT)])
    low, high = ROWS - BOTTOM, TOP
    for index in marked:
        x = round(columns[index])
        chart[high:low, x] = 60
        write_text(chart, (max(x - 10, 0), low + 12), str(int(fit.frames[index])), (190, 190, 190), 12)
    _draw_states(chart, fit, columns, low)
    _draw_curve(chart, columns, fit.confidence.mean(1), CONFIDENCE, low, high)
    write_text(chart, (LEFT, 4), f"confidence 0..1 (mean {fit.confidence.mean():.2f})", CONFIDENCE)
    name = loss_name(fit)
    if name is not None:
        loss = np.nan_to_num(fit.losses[name].astype(np.float64))
        least, most = float(loss.min()), float(loss.max())
        _draw_curve(chart, columns, (loss - least) / max(most - least, 1e-12), LOSS, low, high)
        words = f"{name} loss {least:.4g}..{most:.4g} (mean {loss.mean():.4g})"
        write_text(chart, (LEFT + 240, 4), words, LOSS)
    x = LEFT + 620
    for state, colour in STATE_COLOURS.items():
        write_text(chart, (x, 4), f"{state} {fit.state.count(state)}", colour)
        x += 110
    return chart


def _draw_states(chart: Picture, fit: Fit, columns: Float[np.ndarray, "T"], low: int) -> None:
    half = (columns[1] - columns[0]) / 2.0 if len(columns) > 1 else 4.0
    for x, state in zip(columns.tolist(), fit.state, strict=True):
        chart[low + 2 : low + 8, max(0, round(x - half)) : round(x + half) + 1] = STATE_COLOURS[state]


def _draw_curve(
    chart: Picture,
    columns: Float[np.ndarray, "T"],
    values: Float[np.ndarray, "T"],
    colour: tuple[int, int, int],
    low: int,
    high: int,
) -> None:
    heights = low - np.clip(values, 0.0, 1.0) * (low - high)
    points = np.rint(np.stack([columns, heights], 1) * 16).astype(np.int32)
    cv2.polylines(chart, [points], False, colour, 1, cv2.LINE_AA, 4)
