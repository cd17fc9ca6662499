"""A puppet's parts as game rigs want them: each a mesh of its own with texture coordinates of its own window."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.export.animation import Animation
from wildpuppet.export.json_stream import DECIMALS
from wildpuppet.export.manifest import PositionError, position_error
from wildpuppet.export.naming import printable
from wildpuppet.export.sprites import Window, atlas_window
from wildpuppet.geometry.affine import apply
from wildpuppet.geometry.topology import boundary_edges
from wildpuppet.types import Puppet


class MeshPart(NamedTuple):
    """One part: ``corners`` index the puppet's vertices, ``triangles`` and ``edges`` (the border) index ``corners``.

    ``vertices`` are at rest, canvas pixels; ``uv`` 0..1 of ``window``, the part's texels in the atlas, v down.
    """

    name: str
    window: Window
    corners: Int[np.ndarray, "v"]
    vertices: Float[np.ndarray, "v 2"]
    uv: Float[np.ndarray, "v 2"]
    triangles: Int[np.ndarray, "f 3"]
    edges: Int[np.ndarray, "b 2"]


def mesh_parts(puppet: Puppet) -> list[MeshPart]:
    """Give every part, back to front as at rest."""
    return [_part(puppet, layer) for layer in range(puppet.num_layers)]


def _part(puppet: Puppet, layer: int) -> MeshPart:
    corners = np.flatnonzero(puppet.layer_of_vertex == layer)
    window = atlas_window(puppet, layer)
    triangles = np.searchsorted(corners, puppet.triangles[puppet.layer_of_triangle == layer])
    return MeshPart(
        printable(puppet.names[layer]),
        window,
        corners,
        puppet.vertices[corners].astype(np.float64),
        (puppet.uv[corners] - window[:2]) / window[2:],
        triangles,
        boundary_edges(triangles),
    )


def hull_first(part: MeshPart) -> MeshPart:
    """Put the corners of the longest outline first, in their order."""
    outline = loops(part.edges)[0]
    inner = np.setdiff1d(np.arange(len(part.corners)), outline)
    order = np.concatenate([outline, inner]).astype(np.int64)
    place = np.argsort(order)
    return part._replace(
        corners=part.corners[order],
        vertices=part.vertices[order],
        uv=part.uv[order],
        triangles=place[part.triangles],
        edges=place[part.edges],
    )


def loops(edges: Int[np.ndarray, "b 2"]) -> list[list[int]]:
    """Chain border edges, each in its triangle's direction, into closed outlines, the longest first.

    A corner where an outline touches itself is listed once.
    """
    following: dict[int, list[int]] = {}
    for start, end in edges.tolist():
        following.setdefault(start, []).append(end)
    found = []
    while following:
        loop = [next(iter(following))]
        while loop[-1] in following:
            ends = following[loop[-1]]
            loop.append(ends.pop())
            if not ends:
                del following[loop[-2]]
        found.append(list(dict.fromkeys(loop)))
    return sorted(found, key=len, reverse=True)


def written_error(animation: Animation) -> PositionError:
    """Measure what rounding takes from a rig: corners to 4 decimals in the window, the window to 4 and 7."""
    rest = np.round(animation.puppet.vertices.astype(np.float64), DECIMALS)

    def distances() -> Iterator[Float[np.ndarray, "V"]]:
        for frame in animation:
            window = animation.video_from_crop[frame.t]
            kept = np.column_stack([np.round(window[:, :2], 7), np.round(window[:, 2], DECIMALS)])
            moved = animation.vertices_crop[frame.t].astype(np.float64) - animation.puppet.vertices
            yield np.linalg.norm(apply(kept, rest + np.round(moved, DECIMALS)) - frame.vertices, axis=1)

    return position_error(distances(), "the numbers as written")
