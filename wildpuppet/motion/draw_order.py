"""The draw order between two poses: what changes places, and when.

Where the two orders differ, the parts concerned form groups that each fill the same places of both orders (the
connected pieces of the pairs that change sides). A group changes at once. It does so at the inbetween at which the
changing pairs cover each other least, for a part that goes behind another should do it beside it, and of equal
moments the one nearest the middle.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.types import Puppet

SIDE = 160
"""Pixels of the larger side on which covering is measured."""


def orders_between(
    puppet: Puppet, vertices: Float[np.ndarray, "N V 2"], first: Int[np.ndarray, "L"], last: Int[np.ndarray, "L"]
) -> Int[np.ndarray, "N L"]:
    """List the layers back to front at each inbetween; ``vertices`` are its poses."""
    count = len(vertices)
    orders = np.tile(first, (count, 1))
    for start, stop in changing_spans(first, last):
        pairs = _swapped(first[start:stop], last[start:stop])
        change = _best_moment(_shared(puppet, vertices, pairs))
        orders[change:, start:stop] = last[start:stop]
    return orders


def changing_spans(first: Int[np.ndarray, "L"], last: Int[np.ndarray, "L"]) -> list[tuple[int, int]]:
    """Find the places (start, end not included) of each group of layers that change their order among themselves."""
    place = np.empty(len(last), np.int64)
    place[last] = np.arange(len(last))
    farthest = np.maximum.accumulate(place[first])
    ends = np.flatnonzero(farthest == np.arange(len(first))) + 1
    starts = np.concatenate([[0], ends[:-1]])
    return [(int(start), int(end)) for start, end in zip(starts, ends, strict=True) if end - start > 1]


def _swapped(first: Int[np.ndarray, "G"], last: Int[np.ndarray, "G"]) -> list[tuple[int, int]]:
    place = {int(layer): index for index, layer in enumerate(last)}
    layers = [int(layer) for layer in first]
    return [(a, b) for i, a in enumerate(layers) for b in layers[i + 1 :] if place[a] > place[b]]


def _best_moment(shared: Float[np.ndarray, "N"]) -> int:
    """The inbetween from which the new order is shown; N leaves the change to the last key."""
    count = len(shared)
    if not count:
        return 0
    padded = np.concatenate([[shared[0]], shared, [shared[-1]]])
    cost = (padded[:-1] + padded[1:]) / 2
    near = np.abs(np.arange(count + 1) - count / 2)
    return int(np.lexsort((near, np.round(cost, 6)))[0])


def _shared(
    puppet: Puppet, vertices: Float[np.ndarray, "N V 2"], pairs: list[tuple[int, int]]
) -> Float[np.ndarray, "N"]:
    """Measure how much area the pairs share at each inbetween, as a share of the picture."""
    low, high = vertices.min((0, 1)), vertices.max((0, 1))
    scale = (SIDE - 1) / max(float((high - low).max()), 1e-6)
    small = np.rint((vertices - low) * scale).astype(np.int32)
    sums = []
    for pose in small:
        masks = {layer: _mask(puppet, pose, layer) for layer in {layer for pair in pairs for layer in pair}}
        sums.append(sum(float((masks[a] & masks[b]).mean()) for a, b in pairs))
    return np.array(sums)


def _mask(puppet: Puppet, pose: Int[np.ndarray, "V 2"], layer: int) -> Bool[np.ndarray, "H W"]:
    picture = np.zeros((SIDE, SIDE), np.uint8)
    for triangle in pose[puppet.triangles[puppet.layer_of_triangle == layer]]:
        cv2.fillConvexPoly(picture, triangle, 1)
    return picture > 0
