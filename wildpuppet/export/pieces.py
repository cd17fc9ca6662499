"""The puppet's parts as flat meshes in space: x right, y up, z towards the eye, layers a small gap apart.

Zero is the picture's upper left corner, so y is negative inside the picture. ``units`` is the length of a video pixel.
The order of layers is depth: a layer of rank r stands ``r * GAP`` pixels nearer than the rearmost.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from wildpuppet.export.animation import Frame
from wildpuppet.types import Puppet

GAP = 1.0
"""Distance between neighbouring layers, in pixels."""


@dataclass(frozen=True, eq=False)
class Piece:
    """One part: ``vertices`` are its vertices among the puppet's, ``faces`` count within them and face the eye.

    ``uv`` are 0..1 of the atlas, v down.
    """

    name: str
    layer: int
    vertices: Int[np.ndarray, "n"]
    faces: Int[np.ndarray, "F 3"]
    uv: Float[np.ndarray, "n 2"]


def pieces_of(puppet: Puppet) -> tuple[Piece, ...]:
    """Take the parts apart; one without triangles is left out."""
    facing = facing_eye(puppet)
    unit_uv = puppet.uv / np.array(puppet.atlas.shape[1::-1], np.float64)
    pieces = []
    for layer, name in enumerate(puppet.names):
        mine = np.flatnonzero(puppet.layer_of_vertex == layer)
        faces = np.searchsorted(mine, facing[puppet.layer_of_triangle == layer])
        if len(faces):
            pieces.append(Piece(name, layer, mine, faces, unit_uv[mine]))
    return tuple(pieces)


def facing_eye(puppet: Puppet) -> Int[np.ndarray, "F 3"]:
    """Order each triangle's corners so that it is counter-clockwise at rest once y points up."""
    a, b, c = (puppet.vertices[puppet.triangles[:, k]] for k in range(3))
    first, second = b - a, c - a
    clockwise_up = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0
    return np.where(clockwise_up[:, None], puppet.triangles[:, ::-1], puppet.triangles)


def places(piece: Piece, frame: Frame, units: float) -> Float32[np.ndarray, "n 3"]:
    """Place a part's vertices in space."""
    flat = frame.vertices[piece.vertices] * (units, -units)
    depth = rank_of(piece, frame) * GAP * units
    return np.column_stack([flat, np.full(len(flat), depth)]).astype(np.float32)


def rank_of(piece: Piece, frame: Frame) -> int:
    """How many layers are behind the part."""
    return int(np.flatnonzero(frame.order == piece.layer)[0])


def joint_names(puppet: Puppet) -> list[str]:
    """Name each joint after its two parts."""
    return [f"{puppet.names[int(a)]}_to_{puppet.names[int(b)]}" for a, b in puppet.joint_layers]


def joint_places(puppet: Puppet, vertices: Float[np.ndarray, "V 2"]) -> Float[np.ndarray, "J 2"]:
    """Give each joint's place: the middle of its two points."""
    pairs = np.einsum("jkcd,jkc->jkd", vertices[puppet.joint_vertices], puppet.joint_weights)
    return np.asarray(pairs.mean(1))
