"""The tables' text: which measure stands in which table, what the numbers mean, what was left out."""

from collections.abc import Sequence

from wildpuppet.tables.error import decibels
from wildpuppet.tables.table import Score, markdown

HEAD = """\
Table 1: how far pictures are from the drawings kept for testing. Mean squared error over all pixels and colours,
0..255, of the drawing over white at its own size; lower is better. Every method is given the drawing it is scored on.
"""
DECIBELS = """\
The same in dB (of the means; higher is better):
"""
BOX = """\
The same error over the box of what is drawn, without the paper around it:
"""
PAIRS = """\
Table 2: points carried between any two of the drawings kept for testing, all ordered pairs. Percentage within .1, .05
and .025 of the drawing's larger side; points visible in both count; higher is better.
"""


def paper_text(scores: Sequence[Score], missing: Sequence[str], notes: Sequence[str]) -> str:
    """Write all tables as markdown."""
    lines = [*(f"{note}\n" for note in notes), HEAD, markdown(scores, ["mse"])]
    lines += [DECIBELS, markdown(scores, ["mse"], 2, decibels)]
    lines += [BOX, markdown(scores, ["mse box"])]
    lines += [PAIRS, markdown(scores, ["pck 0.1", "pck 0.05", "pck 0.025"])]
    if missing:
        lines.append("Left out:\n\n" + "".join(f"- {line}\n" for line in missing))
    return "\n".join(lines)
