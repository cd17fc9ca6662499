"""One character's motion on another's puppet.

Parts with the same name turn alike: each turns against its nearest ancestor that has a match by as much as its
namesake does against its own, from the drawn pose: both puppets' drawn poses are taken to mean the same. Squash and
stretch go over as ratios. Hinges are closed; parts that hang on no hinge keep their namesake's distance, in proportion.
A part without a match keeps its drawn pose against its parent. The mesh's own bends belong to the other drawing and
are not carried over.

The puppet becomes as tall as the character it follows times ``height``. Its root moves along the other's way times the
same, about a place that is chosen so that its lowest point stands where the other's stands (the middle over the frames
of each shot). Names are compared without case, spaces, hyphens, underscores and a number in front.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.motion.bones import Bones, BoneTree, bone_tree_of, bones_of, maps_of, posed, turns_of, unwound
from wildpuppet.types import Puppet

SEPARATORS = " _.-"


@dataclass(frozen=True)
class Match:
    """Which parts go together: ``pairs`` of (layer of the one who moves, layer of the one who follows)."""

    pairs: tuple[tuple[int, int], ...]
    unused: tuple[str, ...]
    at_rest: tuple[str, ...]


def match_parts(mover: Puppet, follower: Puppet, given: Mapping[str, str] | None = None) -> Match:
    """Pair parts by name, exact names first; ``at_rest`` are the follower's parts without a match.

    ``given`` pairs names of the follower's parts with names of the mover's before all else; both must exist.
    """
    named = (given or {}).items()
    pairs = [(mover.names.index(theirs), follower.names.index(mine)) for mine, theirs in named]
    for key in (str, plain_name):
        taken = ({a for a, _ in pairs}, {b for _, b in pairs})
        known = {key(name): layer for layer, name in reversed(tuple(enumerate(mover.names))) if layer not in taken[0]}
        for layer, name in enumerate(follower.names):
            if layer not in taken[1] and key(name) in known:
                pairs.append((known.pop(key(name)), layer))
    left, right = {a for a, _ in pairs}, {b for _, b in pairs}
    unused = tuple(name for layer, name in enumerate(mover.names) if layer not in left)
    at_rest = tuple(name for layer, name in enumerate(follower.names) if layer not in right)
    return Match(tuple(sorted(pairs, key=lambda pair: pair[1])), unused, at_rest)


def plain_name(name: str) -> str:
    """Leave out what people write differently, and a layer's number in front (`07-left arm`)."""
    words = re.sub(rf"^\d+[{SEPARATORS}]+", "", name.casefold())
    return "".join(letter for letter in words if letter not in SEPARATORS)


def retarget(
    mover: Puppet,
    vertices: Float[np.ndarray, "T V 2"],
    shots: Int[np.ndarray, "T"],
    follower: Puppet,
    match: Match,
    height: float = 1.0,
) -> Float[np.ndarray, "T W 2"]:
    """Pose ``follower`` by the motion of ``mover``, in the same pixels."""
    source, target = bone_tree_of(mover), bone_tree_of(follower)
    motion = unwound(bones_of(source, vertices))
    size = height * _tall(mover.vertices) / _tall(follower.vertices)
    bones = _carried(source, target, motion, match, size)
    placed = posed(target, bones)
    shift = _grounded(vertices[..., 1].max(1), placed[..., 1].max(1), bones.places, shots, height)
    return np.asarray(placed + shift[:, None])


def _carried(source: BoneTree, target: BoneTree, motion: Bones, match: Match, size: float) -> Bones:
    """Give the follower's bones, the middle of its root where that of its namesake (or of the mover's root) is."""
    count, layers = len(motion), target.puppet.num_layers
    proportion = _tall(target.puppet.vertices) / _tall(source.puppet.vertices)
    partner = {follower: mover for mover, follower in match.pairs}
    turns, logs, gaps = np.zeros((count, layers)), np.zeros((count, layers)), np.zeros((count, layers, 2))
    turned, sized = turns_of(source, motion), turns_of(source, replace(motion, turns=motion.log_scales))
    root = partner.get(target.root, source.root)
    turns[:, target.root], logs[:, target.root] = turned[:, root], sized[:, root] + np.log(size)
    above = {target.root: root}
    for edge in target.edges:
        mine, anchor = partner.get(edge.child), above[edge.parent]
        above[edge.child] = anchor if mine is None else mine
        if mine is not None:
            turns[:, edge.child] = turned[:, mine] - turned[:, anchor]
            logs[:, edge.child] = sized[:, mine] - sized[:, anchor]
            if not edge.is_hinge and source.parents.get(mine) == anchor:
                gaps[:, edge.child] = motion.gaps[:, mine] * proportion
    bends = np.zeros((count, *target.puppet.vertices.shape))
    return Bones(_middles(source, motion, root), turns, logs, gaps, bends)


def _middles(tree: BoneTree, motion: Bones, layer: int) -> Float[np.ndarray, "T 2"]:
    """Follow the middle of a part."""
    middle = tree.puppet.vertices[tree.puppet.layer_of_vertex == layer].astype(np.float64).mean(0)
    maps = maps_of(tree, motion)[:, layer]
    return np.asarray(maps[..., :2] @ middle + maps[..., 2])


def _grounded(
    theirs: Float[np.ndarray, "T"],
    mine: Float[np.ndarray, "T"],
    places: Float[np.ndarray, "T 2"],
    shots: Int[np.ndarray, "T"],
    height: float,
) -> Float[np.ndarray, "T 2"]:
    """Scale the root's way by ``height``, and shift each shot as a whole so that both stand on one ground.

    ``theirs`` and ``mine`` are how low each of the two reaches, ``places`` where the root is.
    """
    shift = np.zeros((len(places), 2))
    for shot in np.unique(shots):
        rows = shots == shot
        shift[rows] = (height - 1.0) * (places[rows] - np.median(places[rows], axis=0))
        shift[rows, 1] += np.median(theirs[rows] - mine[rows] - shift[rows, 1])
    return shift


def _tall(vertices: Float[np.ndarray, "V 2"]) -> float:
    return max(float(np.ptp(vertices[:, 1])), 1e-6)


def carried_order(
    order: Int[np.ndarray, "T L"], mover: Puppet, follower: Puppet, match: Match
) -> Int[np.ndarray, "T M"]:
    """Let matched parts change places as their namesakes do; where those lie as drawn, so does the follower."""
    partner = dict(match.pairs)
    drawn = [layer for layer in range(mover.num_layers) if layer in partner]
    slots = sorted(partner.values())
    rows = np.tile(np.arange(follower.num_layers), (len(order), 1))
    for t, row in enumerate(order.tolist()):
        found = [layer for layer in row if layer in partner]
        if found != drawn:
            rows[t, slots] = [partner[layer] for layer in found]
    return rows
