"""The tables' text: which measure stands in which table, what the numbers mean, what was left out."""

from collections.abc import Sequence

from wildpuppet.tables.drags import COUNTS
from wildpuppet.tables.error import decibels
from wildpuppet.tables.inbetweens import MEASURES
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
INBETWEEN = """\
Table 3: test drawings left out and predicted from the drawings before and after, on our own runs. Mean distance in
pixels: of all vertices from the drawing's own fit / of true points, the neighbours posed by true points too / of lines
from the drawing's lines (Chamfer). Lower is better; only drawings between two others of the same motion count.
"""
DRAG = """\
Table 4: 1 / 2 / 3 points of the training drawing before a test drawing dragged to where they are in that, on our own
runs. Mean distance in pixels of all points that are seen from where they are; lower is better. start: nothing is
dragged; printed: the paper's energy over the vertices; vertices: the same against the pose that is dragged, a better
baseline; paper: plain steps in the code.
"""


def paper_text(scores: Sequence[Score], missing: Sequence[str], notes: Sequence[str]) -> str:
    """Write all tables as markdown."""
    lines = [*(f"{note}\n" for note in notes), HEAD, markdown(scores, ["mse"])]
    lines += [DECIBELS, markdown(scores, ["mse"], 2, decibels)]
    lines += [BOX, markdown(scores, ["mse box"])]
    lines += [PAIRS, markdown(scores, ["pck 0.1", "pck 0.05", "pck 0.025"])]
    if any(score.measure.startswith("inbetween") for score in scores):
        lines += [INBETWEEN, markdown(scores, [f"inbetween {measure}" for measure in MEASURES], 2)]
    if any(score.measure.startswith("drag") for score in scores):
        lines += [DRAG, markdown(scores, [f"drag {count}" for count in COUNTS])]
    if missing:
        lines.append("Left out:\n\n" + "".join(f"- {line}\n" for line in missing))
    return "\n".join(lines)
