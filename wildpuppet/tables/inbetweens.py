"""Table 3 and its figure: every test drawing predicted from the drawings before and after it."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import UInt8

from wildpuppet.motion.bones import bone_tree_of
from wildpuppet.motion.draw_order import orders_between
from wildpuppet.motion.inbetween import Method
from wildpuppet.motion.lines import drawn_on_white
from wildpuppet.motion.passages import drawings_of
from wildpuppet.motion.score import LeftOut, predictions
from wildpuppet.render.render import mesh_of, texture_at
from wildpuppet.tables.flow import nearest
from wildpuppet.types import Crops, Fit, Puppet

Picture = UInt8[np.ndarray, "H W 3"]

MEASURES = ("vertices", "true_points", "lines")
SHOWN: tuple[Method, ...] = ("ours", "linear", "arap")


def inbetween_scores(left_out: LeftOut) -> dict[tuple[str, str], float]:
    """Give the mean of each measure by method, for (method, measure)."""
    table = left_out.table()
    return {
        (method, measure): value
        for measure in MEASURES
        for method, value in table.get(measure, {}).items()
        if np.isfinite(value)
    }


def inbetween_rows(
    puppet: Puppet, crops: Crops, fit: Fit, picture: Callable[[int], Picture], frames: Sequence[int]
) -> dict[str, list[Picture]]:
    """Draw the left-out drawings' predictions, a column per method.

    ``picture`` gives a drawing by frame number, over white; beside them stand the drawing itself, those before and
    after it, and of all other drawings the one whose pixels are nearest to our prediction, as the paper checks.
    """
    tree, drawings = bone_tree_of(puppet), drawings_of(crops, fit)
    mesh, texture = mesh_of(puppet), texture_at(puppet, 1.0)
    numbers = drawings.times.astype(int)
    columns: dict[str, list[Picture]] = {}
    for frame in frames:
        k = int(np.flatnonzero(numbers == frame)[0])
        drawing = picture(frame)
        size = (drawing.shape[1], drawing.shape[0])
        row = {"before": picture(int(numbers[k - 1])), "left out": drawing}
        for method, vertices in predictions(tree, drawings, k, SHOWN).items():
            order = orders_between(puppet, vertices[None], drawings.order[k - 1], drawings.order[k + 1])[0]
            row[method] = drawn_on_white(mesh, texture, vertices, order, size)
        others = [picture(int(number)) for number in numbers if number != frame]
        row["nearest other"] = others[nearest(others, row["ours"])]
        row["after"] = picture(int(numbers[k + 1]))
        for name, shown in row.items():
            columns.setdefault(name, []).append(shown)
    return columns
