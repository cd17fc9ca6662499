"""Which frames are fitted together: whole held drawings. Numpy only: a run that is kept asks for this and no more."""

import numpy as np
from jaxtyping import Int


def spans_of(drawing: Int[np.ndarray, "T"], size: int) -> list[slice]:
    """Cut the frames, numbered by drawing, into runs of at least ``size`` that never split a held drawing."""
    starts = np.flatnonzero(np.r_[True, np.diff(drawing) != 0])
    cuts = [0]
    for start in starts.tolist():
        if start - cuts[-1] >= size:
            cuts.append(start)
    return [slice(a, b) for a, b in zip(cuts, [*cuts[1:], len(drawing)], strict=True)]
