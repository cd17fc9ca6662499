"""Affine maps of the plane as (2, 3) matrices, destination first: ``a_from_b @ [x, y, 1]``.

Corner origin: the centre of the first pixel is (0.5, 0.5), so that a resize is a pure scale. OpenCV puts pixel
centres on integers; ``for_opencv`` is the one place where that convention is met.
"""

import numpy as np
from jaxtyping import Float


def apply(
    a_from_b: Float[np.ndarray, "*#batch 2 3"], points: Float[np.ndarray, "*#batch n 2"]
) -> Float[np.ndarray, "*#batch n 2"]:
    """Map points."""
    linear, offset = a_from_b[..., :2], a_from_b[..., 2]
    mapped: Float[np.ndarray, "*#batch n 2"] = points @ np.swapaxes(linear, -1, -2) + offset[..., None, :]
    return mapped


def compose(
    a_from_b: Float[np.ndarray, "*#batch 2 3"], b_from_c: Float[np.ndarray, "*#batch 2 3"]
) -> Float[np.ndarray, "*#batch 2 3"]:
    """Chain two maps: a_from_c."""
    linear = a_from_b[..., :2] @ b_from_c[..., :2]
    offset = (a_from_b[..., :2] @ b_from_c[..., 2:])[..., 0] + a_from_b[..., 2]
    return np.concatenate([linear, offset[..., None]], -1)


def invert(a_from_b: Float[np.ndarray, "*batch 2 3"]) -> Float[np.ndarray, "*batch 2 3"]:
    """Invert a map; raises numpy.linalg.LinAlgError where it is singular."""
    inverse = np.linalg.inv(a_from_b[..., :2])
    return np.concatenate([inverse, -inverse @ a_from_b[..., 2:]], -1)


def scale_and_shift(scale: float, shift: tuple[float, float]) -> Float[np.ndarray, "2 3"]:
    """Build x -> scale * x + shift."""
    return np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])


def similarity(
    scale: Float[np.ndarray, "*batch"], radians: Float[np.ndarray, "*batch"], shift: Float[np.ndarray, "*batch 2"]
) -> Float[np.ndarray, "*batch 2 3"]:
    """Build a turn by ``radians`` (x towards y, so clockwise on screen), a scale and a shift."""
    cos, sin = scale * np.cos(radians), scale * np.sin(radians)
    rows = np.stack([np.stack([cos, -sin, shift[..., 0]], -1), np.stack([sin, cos, shift[..., 1]], -1)], -2)
    return rows


def turn_of(a_from_b: Float[np.ndarray, "*batch 2 _"]) -> Float[np.ndarray, "*batch"]:
    """Give the turn (radians) of the rotation nearest to a map, or to its linear part alone (2, 2)."""
    across = a_from_b[..., 1, 0] - a_from_b[..., 0, 1]
    return np.asarray(np.arctan2(across, a_from_b[..., 0, 0] + a_from_b[..., 1, 1]))


def for_opencv(a_from_b: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
    """Turn a corner-origin map into the same map between pixel-centre coordinates, as OpenCV's warps expect."""
    half = np.array([0.5, 0.5])
    shifted = a_from_b.astype(np.float64).copy()
    shifted[:, 2] += shifted[:, :2] @ half - half
    return shifted
