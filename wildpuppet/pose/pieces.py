"""A puppet cut at its bends: what the search moves are rigid pieces."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.pose.tree import joint_points
from wildpuppet.puppet.atlas import assemble, cut_window, shelf_pack, window_of
from wildpuppet.puppet.bends import is_of_half, reach_along, skin
from wildpuppet.puppet.joints import attach
from wildpuppet.types import Puppet

MARGIN = 4.0
"""Pixels that a piece's mesh reaches beyond the disc about its bend."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """``puppet`` has a layer per rigid piece of the ``whole`` one, and its joints, then a joint per bend.

    ``vertex`` is each of its vertices' number in the whole puppet, ``piece_of_vertex`` the piece that moves each vertex
    of the whole puppet most.
    """

    whole: Puppet
    puppet: Puppet
    vertex: Int[np.ndarray, "W"]
    piece_of_vertex: Int[np.ndarray, "V"]

    def parted(self, order: Int[np.ndarray, "*batch L"]) -> Int[np.ndarray, "*batch P"]:
        """Turn an order of layers into one of pieces."""
        rank = np.argsort(order, -1)[..., self.whole.layer_of_piece]
        return np.asarray(np.argsort(rank, -1, kind="stable"))

    def joined(self, order: Int[np.ndarray, "*batch P"]) -> Int[np.ndarray, "*batch L"]:
        """Turn an order of pieces into one of layers, each where its first piece is."""
        layers = self.whole.layer_of_piece
        is_first = np.r_[True, np.diff(layers) != 0]
        return np.asarray(layers[order[is_first[order]]].reshape(*order.shape[:-1], -1))


def pieces_of(puppet: Puppet) -> Pieces:
    """Cut a puppet at its bends."""
    if not len(puppet.bend_layers):
        return Pieces(puppet, puppet, np.arange(len(puppet.vertices)), puppet.layer_of_vertex)
    cut = [_cut(puppet, int(layer), side) for layer, side in _sides(puppet)]
    starts = np.cumsum([0] + [len(used) for used, _, _, _ in cut])
    vertex = np.concatenate([used for used, _, _, _ in cut])
    vertices = puppet.vertices[vertex]
    triangles = np.concatenate([own + start for (_, own, _, _), start in zip(cut, starts, strict=False)])
    layer_of_vertex = np.repeat(np.arange(len(cut)), np.diff(starts))
    windows = np.array([window for _, _, window, _ in cut])
    size, corners = shelf_pack(windows[:, 2:])
    touched = _joints(puppet)
    corners_of, weights = _attached(touched, vertices, triangles, layer_of_vertex)
    parted = Puppet(
        tuple(puppet.names[layer] + ("~" if side > 0 else "") for layer, side in _sides(puppet)),
        puppet.canvas,
        vertices,
        triangles,
        layer_of_vertex,
        vertices + (corners - windows[:, :2])[layer_of_vertex],
        assemble(size, [texture for _, _, _, texture in cut], corners),
        np.array([pieces for pieces, _ in touched], np.int64).reshape(-1, 2),
        corners_of,
        weights,
        puppet.reference,
    )
    pieces, share = skin(puppet)
    return Pieces(puppet, parted, vertex, np.where(share > 0.5, pieces[:, 1], pieces[:, 0]))


def _sides(puppet: Puppet) -> list[tuple[int, int]]:
    """List the pieces: a layer, and on which side of its bend (0: it has none)."""
    bent = set(puppet.bend_layers.tolist())
    return [(layer, side) for layer in range(puppet.num_layers) for side in ((-1, 1) if layer in bent else (0,))]


_Cut = tuple[Int[np.ndarray, "n"], Int[np.ndarray, "m 3"], tuple[int, int, int, int], UInt8[np.ndarray, "h w 4"]]


def _cut(puppet: Puppet, layer: int, side: int) -> _Cut:
    """Cut out a piece: vertices (numbers in the whole), triangles (of those), window on the canvas, texture."""
    triangles = puppet.triangles[puppet.layer_of_triangle == layer]
    mine = np.flatnonzero(puppet.layer_of_vertex == layer)
    bend = int(np.searchsorted(puppet.bend_layers, layer))
    if side:
        point, axis = puppet.bend_points[bend], puppet.bend_axes[bend]
        beyond = side * reach_along(puppet.vertices, point, axis) >= -1 - MARGIN / np.linalg.norm(axis)
        triangles = triangles[beyond[triangles].any(1)]
    used, own = np.unique(triangles, return_inverse=True)
    window = window_of(puppet.vertices[used])
    shift = np.rint(puppet.uv[mine[0]] - puppet.vertices[mine[0]]).astype(int)
    corner = np.array(window[:2])
    left, top = corner + shift
    texture = cut_window(puppet.atlas, (int(left), int(top), *window[2:]))
    rows, columns = np.indices(texture.shape[:2])
    points = np.stack([columns, rows], -1) + 0.5 + corner
    low, high = puppet.vertices[mine].min(0) - 1, puppet.vertices[mine].max(0) + 1
    kept = ((points >= low) & (points <= high)).all(-1)  # beside them lie other layers' pictures
    if side:
        kept &= is_of_half(points, point, axis, side)
    texture[..., 3] *= kept
    return used, own.reshape(-1, 3), window, texture


def _joints(puppet: Puppet) -> list[tuple[tuple[int, int], Float[np.ndarray, "2"]]]:
    """List the pieces that each joint ties and where: the puppet's joints, then one per bend."""
    first = np.searchsorted(puppet.layer_of_piece, np.arange(puppet.num_layers))
    bends = {int(layer): k for k, layer in enumerate(puppet.bend_layers)}

    def piece(layer: int, at: Float[np.ndarray, "2"]) -> int:
        k = bends.get(layer)
        is_beyond = k is not None and reach_along(at, puppet.bend_points[k], puppet.bend_axes[k]) > 0
        return int(first[layer]) + int(is_beyond)

    places = joint_points(puppet).mean(1)
    joints = [
        ((piece(int(a), at), piece(int(b), at)), at) for (a, b), at in zip(puppet.joint_layers, places, strict=True)
    ]
    at_bends = [
        ((int(first[layer]), int(first[layer]) + 1), point)
        for layer, point in zip(puppet.bend_layers, puppet.bend_points, strict=True)
    ]
    return joints + at_bends


def _attached(
    joints: list[tuple[tuple[int, int], Float[np.ndarray, "2"]]],
    vertices: Float[np.ndarray, "W 2"],
    triangles: Int[np.ndarray, "G 3"],
    layer_of_vertex: Int[np.ndarray, "W"],
) -> tuple[Int[np.ndarray, "J 2 3"], Float[np.ndarray, "J 2 3"]]:
    corners, weights = np.zeros((len(joints), 2, 3), np.int64), np.zeros((len(joints), 2, 3))
    layer_of_triangle = layer_of_vertex[triangles[:, 0]]
    for j, (pieces, at) in enumerate(joints):
        for k, piece in enumerate(pieces):
            corners[j, k], weights[j, k] = attach(at, vertices, triangles[layer_of_triangle == piece])
    return corners, weights
