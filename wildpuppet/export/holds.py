"""Held drawings as one mesh that moves as a whole: what formats with a node over a mesh can keep exactly.

While a drawing is held the camera may go on and the fit may turn the whole puppet a little, so a held frame's vertices
are those of the drawing's first frame under one similarity (shift, turn, zoom). Where they are, to ``SAME_PIXELS``,
the frame needs no mesh of its own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.export.animation import Animation
from wildpuppet.geometry.affine import apply

SAME_PIXELS = 2e-3
"""Farthest that any vertex may be from the moved drawing: a few roundings of the fit's float32."""
Similarity = Float[np.ndarray, "2 3"]
IDENTITY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Holds:
    """``drawing[t]`` numbers frame t's mesh, ``first[d]`` is the frame whose vertices it is, in video pixels.

    ``moved[t]`` takes the mesh to its place in frame t.
    """

    drawing: Int[np.ndarray, "T"]
    first: Int[np.ndarray, "D"]
    moved: Float[np.ndarray, "T 2 3"]


def holds_of(animation: Animation) -> Holds:
    """Find the frames that show an earlier frame's mesh: held ones, and those that repeat one in the crop exactly."""
    firsts: list[int] = []
    drawing = np.zeros(len(animation), np.int64)
    moved = np.tile(IDENTITY, (len(animation), 1, 1))
    seen: dict[int, int] = {}
    for t in range(len(animation)):
        known = seen.get(int(animation.pose[t]))
        if known is None and t and animation.state[t] == "held":
            known = int(drawing[t - 1])
        motion = None if known is None else motion_between(animation.vertices(firsts[known]), animation.vertices(t))
        if known is None or motion is None:
            known = len(firsts)
            firsts.append(t)
        else:
            moved[t] = motion
        drawing[t] = known
        seen.setdefault(int(animation.pose[t]), known)
    return Holds(drawing, np.array(firsts, np.int64), moved)


def motion_between(before: Float[np.ndarray, "V 2"], after: Float[np.ndarray, "V 2"]) -> Similarity | None:
    """Find the similarity that takes ``before`` to ``after``; None where there is none to ``SAME_PIXELS``."""
    a, b = before - before.mean(0), after - after.mean(0)
    spread = float((a**2).sum())
    if spread <= 0.0:
        return None
    cos = float((a * b).sum()) / spread
    sin = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / spread
    linear = np.array([[cos, -sin], [sin, cos]])
    motion = np.column_stack([linear, after.mean(0) - linear @ before.mean(0)])
    if np.hypot(cos, sin) < 1e-6 or np.abs(apply(motion, before) - after).max() > SAME_PIXELS:
        return None
    return motion
