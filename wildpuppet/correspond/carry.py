"""Carry points from one frame to every frame through the puppet.

A point is located once on the mesh (``locate``); in every other frame it is the same mix of the same three vertices.
Hidden points are carried too: the puppet knows where a covered hand is. ``visible`` says whether it is seen.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.correspond import cover
from wildpuppet.correspond.locate import Anchors, locate
from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import apply
from wildpuppet.types import Crops, Fit, PointTracks, Puppet


def carry(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    points_video: Float[np.ndarray, "N 2"],
    frame: int,
    parts: Sequence[str | None] | None = None,
    size: tuple[int, int] | None = None,
) -> PointTracks:
    """Carry points given in clip frame ``frame`` to every frame of the run.

    ``parts[n]`` names the part point n lies on (for points hidden in that frame); None: the frontmost drawing under
    it, else the nearest. ``size`` (W, H) of the video: points beyond it are not visible. In frames without the
    character (state lost) nothing is visible and confidence is 0. Points that are not finite stay so. Raises
    InputError for a frame outside the run or an unknown part.
    """
    index = frame_index(fit, frame)
    points = np.asarray(points_video, np.float64).reshape(-1, 2)
    vertices_video = apply(crops.video_from_crop, fit.vertices_crop.astype(np.float64))
    anchors = locate(puppet, vertices_video[index], fit.order[index], points, parts)
    carried = anchors.mix(vertices_video)
    carried[index] = points  # the given frame is given, not computed
    seen = _seen(puppet, fit, vertices_video, carried, anchors, size)
    return PointTracks(fit.frames, carried, seen, _confidence(puppet, fit, vertices_video[index], anchors))


def frame_index(fit: Fit, frame: int) -> int:
    """Index of a clip frame in the run; raises InputError where the run does not hold it."""
    found = np.flatnonzero(fit.frames == frame)
    if not len(found):
        first, last = int(fit.frames[0]), int(fit.frames[-1])
        raise InputError(f"expected a frame of the run ({first} to {last}), found {frame}")
    return int(found[0])


def _seen(
    puppet: Puppet,
    fit: Fit,
    vertices_video: Float[np.ndarray, "T V 2"],
    carried: Float[np.ndarray, "T N 2"],
    anchors: Anchors,
    size: tuple[int, int] | None,
) -> Bool[np.ndarray, "T N"]:
    hidden = cover.covered(
        vertices_video, puppet.triangles, puppet.layer_of_triangle, cover.rank_of(fit.order), puppet.uv,
        puppet.atlas[..., 3], carried, anchors.layer,
    )  # fmt: skip
    seen = ~hidden & np.isfinite(carried).all(-1) & ~_lost(fit)[:, None]
    if size is not None:
        seen &= ((carried >= 0.0) & (carried < np.array(size, np.float64))).all(-1)
    return np.asarray(seen)


def _confidence(
    puppet: Puppet,
    fit: Fit,
    vertices: Float[np.ndarray, "V 2"],
    anchors: Anchors,
) -> Float[np.ndarray, "T N"]:
    """Mix the vertices' confidence, which knows of what is hidden; less for points beside the mesh."""
    inside = np.clip(np.nan_to_num(anchors.weights), 0.0, None)
    inside /= np.maximum(inside.sum(1, keepdims=True), 1e-12)
    mixed = np.einsum("tnk,nk->tn", fit.confidence[:, anchors.corners].astype(np.float64), inside)
    mixed /= 1.0 + anchors.outside / _edge_length(puppet.triangles, vertices)
    mixed[_lost(fit)] = 0.0
    return np.asarray(np.clip(mixed, 0.0, 1.0))


def _edge_length(triangles: Int[np.ndarray, "F 3"], vertices: Float[np.ndarray, "V 2"]) -> float:
    edges = vertices[triangles] - vertices[np.roll(triangles, 1, axis=1)]
    return max(float(np.linalg.norm(edges, axis=-1).mean()), 1e-12)


def _lost(fit: Fit) -> Bool[np.ndarray, "T"]:
    return np.array([state == "lost" for state in fit.state], bool)
