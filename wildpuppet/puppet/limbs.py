"""Where to cut a silhouette into a body and limbs, by its medial axis.

Walking outwards from the middle of the body, a limb begins where the silhouette narrows to a share of the part's own
thickness and still goes on for a limb's length. A long even limb is cut once more at its bend.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from wildpuppet.puppet.skeleton import Skeleton

NARROW = 0.65
"""A part ends where the radius falls below this share of its largest."""
FLARE = 0.35
"""The cut moves outwards as long as the radius falls by more than this per pixel (a shoulder, a hip)."""
SLENDER = 2.6
"""A limb this many times longer than wide is cut at its bend."""
ROOT_SHARE = 0.5
"""A cut lies within this share of the way from where the narrowing begins to the tip."""


@dataclass(frozen=True, eq=False)
class Cut:
    """A limb's root: the skeleton node it is cut at and how far the limb sticks out from there."""

    node: int
    length: float


def find_cuts(skeleton: Skeleton, least_length: float, most: int) -> list[int]:
    """Choose at most ``most`` nodes to cut at; limbs stick out by ``least_length`` pixels at least."""
    onward = skeleton.toward_tip()
    limbs = _limb_roots(skeleton, onward, least_length)
    bends = [bend for limb in limbs for bend in _bend(skeleton, onward, limb, limbs, least_length)]
    ranked = sorted(limbs, key=lambda cut: -cut.length) + sorted(bends, key=lambda cut: -cut.length)
    return sorted(cut.node for cut in ranked[:most])


def label_nodes(skeleton: Skeleton, cuts: list[int]) -> Int[np.ndarray, " N"]:
    """Number each node's part: 0 is the body, ``1 + i`` the part that begins at the i-th cut."""
    labels = np.zeros(len(skeleton.parent), np.int64)
    begins = {node: 1 + index for index, node in enumerate(cuts)}
    for node in range(1, len(labels)):
        labels[node] = begins.get(node, labels[skeleton.parent[node]])
    return labels


def label_pixels(
    mask: Bool[np.ndarray, "H W"], skeleton: Skeleton, labels: Int[np.ndarray, " N"]
) -> Int[np.ndarray, "H W"]:
    """Give each pixel the part of the disc that it lies deepest in, -1 outside the mask; each part is one piece."""
    pixels = np.argwhere(mask)[:, ::-1] + 0.5
    depth = np.full((int(labels.max()) + 1, len(pixels)), -np.inf)
    for part in range(len(depth)):
        for node in np.flatnonzero(labels == part)[::2]:
            inside = skeleton.radius[node] - np.linalg.norm(pixels - skeleton.points[node], axis=1)
            np.maximum(depth[part], inside, out=depth[part])
    found = np.full(mask.shape, -1, np.int64)
    found[mask] = depth.argmax(axis=0)
    return _in_one_piece(found, len(depth))


def _in_one_piece(found: Int[np.ndarray, "H W"], num_parts: int) -> Int[np.ndarray, "H W"]:
    """Give the smaller pieces of a part to whichever part is nearest."""
    sure = np.zeros(found.shape, bool)
    for part in range(num_parts):
        pieces, count = ndimage.label(found == part)
        if count:
            sure |= pieces == 1 + np.bincount(pieces[pieces > 0] - 1).argmax()
    _, (rows, columns) = ndimage.distance_transform_edt(~sure, return_indices=True)
    return np.where(found >= 0, found[rows, columns], -1)


def _limb_roots(skeleton: Skeleton, onward: Int[np.ndarray, " N"], least_length: float) -> list[Cut]:
    """Walk outwards; ``widest`` is the largest radius seen since the part began."""
    widest = skeleton.radius.copy()
    cuts: list[Cut] = []
    roots: set[int] = set()
    passed: set[int] = set()
    for node in range(1, len(widest)):
        if node in roots:
            continue
        widest[node] = max(widest[skeleton.parent[node]], skeleton.radius[node])
        is_narrow = skeleton.radius[node] < NARROW * widest[node]
        if not is_narrow or node in passed or _sticks_out(skeleton, node) < least_length:
            continue
        root = _slide(skeleton, onward, node, least_length)
        passed.update(_path(skeleton, node, root))
        roots.add(root)
        widest[root] = skeleton.radius[root]
        cuts.append(Cut(root, _sticks_out(skeleton, root)))
    return cuts


def _sticks_out(skeleton: Skeleton, node: int) -> float:
    return float(skeleton.reach[node] - skeleton.radius[node])


def _slide(skeleton: Skeleton, onward: Int[np.ndarray, " N"], node: int, least_length: float) -> int:
    """Move a cut outwards along the longest path to where the narrowing levels off."""
    begin, limit = skeleton.depth[node], ROOT_SHARE * skeleton.reach[node]
    best, cost, here = node, float(skeleton.radius[node]), node
    while onward[here] != here and skeleton.depth[here] - begin < limit:
        here = int(onward[here])
        moved = float(skeleton.radius[here] + FLARE * (skeleton.depth[here] - begin))
        if moved < cost and _sticks_out(skeleton, here) >= least_length:
            best, cost = here, moved
    return best


def _path(skeleton: Skeleton, top: int, bottom: int) -> list[int]:
    """List the nodes from ``bottom`` up to ``top``."""
    nodes = [bottom]
    while nodes[-1] != top:
        nodes.append(int(skeleton.parent[nodes[-1]]))
    return nodes


def _bend(
    skeleton: Skeleton, onward: Int[np.ndarray, " N"], limb: Cut, limbs: list[Cut], least_length: float
) -> list[Cut]:
    """Find where a slender limb bends most in its middle third, if it is long enough for two parts."""
    nodes, roots = [limb.node], {cut.node for cut in limbs}
    while onward[nodes[-1]] != nodes[-1] and int(onward[nodes[-1]]) not in roots:
        nodes.append(int(onward[nodes[-1]]))
    path = np.array(nodes)
    along = skeleton.depth[path] - skeleton.depth[limb.node]
    length, width = float(along[-1] + skeleton.radius[path[-1]]), 2.0 * float(np.median(skeleton.radius[path]))
    if length < SLENDER * width or length < 2.0 * least_length:
        return []
    middle = path[(along >= 0.35 * length) & (along <= 0.65 * length)]
    if not len(middle):
        return []
    node = int(middle[_sharpness(skeleton.points, skeleton.points[path], middle).argmax()])
    return [Cut(node, _sticks_out(skeleton, node))]


def _sharpness(
    points: Float[np.ndarray, "N 2"], path: Float[np.ndarray, "P 2"], middle: Int[np.ndarray, " M"]
) -> Float[np.ndarray, " M"]:
    """Measure how far each node lies off the straight line from the path's first point to its last."""
    chord = path[-1] - path[0]
    off = points[middle] - path[0]
    distance = np.abs(chord[0] * off[:, 1] - chord[1] * off[:, 0]) / max(float(np.linalg.norm(chord)), 1e-6)
    centred = -np.abs(np.arange(len(middle)) - 0.5 * (len(middle) - 1)) / max(len(middle), 1)
    sharpness: Float[np.ndarray, " M"] = distance + 2.0 * centred
    return sharpness
