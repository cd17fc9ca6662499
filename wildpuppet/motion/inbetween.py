"""Poses between two poses.

- ``linear``: every vertex goes straight. Turning limbs shrink.
- ``arap``: as-rigid-as-possible interpolation (``as_rigid``).
- ``hinges``: every part turns about its hinge at constant speed, and only what is left bends linearly (``bones``).
- ``ours``: the same along curves that know the drawing before and the drawing after, each kind of motion (the root's
  way, turns, scales, hinge gaps, bends) with the strength that the run's own drawings show (``curves``).
- ``code``: the paper's: the network's codes are mixed and decoded; what the decoder misses of the two poses is mixed
  linearly and put back.

All of them give the two poses themselves at both ends.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.motion.as_rigid import as_rigid_between, as_rigid_of
from wildpuppet.motion.bones import Bones, BoneTree, bones_of, posed, unwound, wrapped
from wildpuppet.motion.curves import Times, bulge, chord, fitted_strength
from wildpuppet.motion.passages import Drawings

Method = Literal["ours", "hinges", "arap", "linear", "code"]
METHODS: tuple[Method, ...] = ("ours", "hinges", "arap", "linear", "code")

KINDS = tuple(field.name for field in fields(Bones))
PRIOR = 0.75
"""Strength of the curves where a run in order has few drawings to learn from."""
FAR, UNSEEN, SEEN = np.pi / 2.0, np.pi / 4.0, np.pi / 9.0
"""A turn that may go either way (90 degrees); how far from all that is seen (45) and how near to it (20) is telling."""
MOST_CASES = 64
"""Drawings that the strengths are learnt from, evenly spread."""

Decoder = Callable[[Float[np.ndarray, "B Z"], Float[np.ndarray, "B"]], Float[np.ndarray, "B V 2"]]
"""Turns codes into vertices in the keys' pixels; it is told at which share of the way each of them is."""
Strengths = dict[str, float]


@dataclass(frozen=True, eq=False)
class Keys:
    """Two poses and, if there are, the one before and the one after; poses of times that are NaN do not count."""

    times: Times
    vertices: Float[np.ndarray, "4 V 2"]
    winding: Float[np.ndarray, "L"] | None = None
    """What is added to each part's turn from the first to the last key, which is the short way: whole turns."""


@dataclass(frozen=True, eq=False)
class Codes:
    """The two poses' codes and what turns codes into vertices."""

    first: Float[np.ndarray, "Z"]
    last: Float[np.ndarray, "Z"]
    decode: Decoder


def keys_of(drawings: Drawings, first: int, last: int) -> Keys:
    """Take drawings ``first`` and ``last`` as keys, and those around them if all are of one passage."""
    before, after = first - 1, last + 1
    same = drawings.passage[first] == drawings.passage[last]
    has = [same and 0 <= k < len(drawings) and drawings.passage[k] == drawings.passage[first] for k in (before, after)]
    times = Times(
        float(drawings.times[before]) if has[0] else np.nan,
        float(drawings.times[first]),
        float(drawings.times[last]),
        float(drawings.times[after]) if has[1] else np.nan,
    )
    rows = [before if has[0] else first, first, last, after if has[1] else last]
    return Keys(times, drawings.vertices[rows])


def with_winding(tree: BoneTree, drawings: Drawings, keys: Keys, closed: Int[np.ndarray, "n"] | None = None) -> Keys:
    """Let parts that turn far go the way that the run's drawings have them turn.

    A part goes the long way round where halfway along the short way it would be farther than ``UNSEEN`` from every
    turn that the drawings show, and halfway along the long way nearer than ``SEEN`` to one: legs do not swing
    overhead. ``closed`` drawings are not looked at.
    """
    bones = unwound(bones_of(tree, keys.vertices[1:3]))
    turn = bones.turns[1] - bones.turns[0]
    if not (np.abs(turn) > FAR).any():
        return keys
    known = np.delete(drawings.vertices, [] if closed is None else closed, axis=0)
    seen = bones_of(tree, known).turns
    middle = (bones.turns[0] + bones.turns[1]) / 2.0
    short = np.abs(wrapped(seen - middle)).min(0)
    long = np.abs(wrapped(seen - middle - np.pi)).min(0)
    goes_long = (np.abs(turn) > FAR) & (short > UNSEEN) & (long < SEEN)
    return replace(keys, winding=np.where(goes_long, -np.sign(turn) * 2.0 * np.pi, 0.0))


def even_shares(count: int) -> Float[np.ndarray, "N"]:
    """Place ``count`` inbetweens evenly."""
    return np.arange(1, count + 1) / (count + 1)


def between(
    tree: BoneTree,
    keys: Keys,
    shares: Float[np.ndarray, "N"],
    method: Method = "ours",
    strengths: Strengths | None = None,
    codes: Codes | None = None,
) -> Float[np.ndarray, "N V 2"]:
    """Give the poses at ``shares`` of the way from the first to the last key.

    ``strengths`` (of ``strengths_of``) bend the curves of ``ours``; 0, straight, where left out. Raises ValueError for
    ``code`` without codes.
    """
    first, last = keys.vertices[1], keys.vertices[2]
    if method == "linear":
        return np.stack([chord(first, last, share) for share in shares.tolist()])
    if method == "arap":
        return as_rigid_between(as_rigid_of(tree), first, last, shares)
    if method == "code":
        return _by_codes(keys, shares, codes)
    bones = unwound(bones_of(tree, keys.vertices))
    if keys.winding is not None:
        bones = replace(bones, turns=bones.turns + np.array([0.0, 0.0, 1.0, 1.0])[:, None] * keys.winding)
    wanted = (strengths or {}) if method == "ours" else {}
    return posed(tree, _along(bones, keys.times, shares, wanted))


def strengths_of(
    tree: BoneTree, drawings: Drawings, first: int, last: int, hidden: Int[np.ndarray, "n"] | None = None
) -> Strengths:
    """Learn the curves' strengths from the run's other drawings, at the spacing of drawings ``first`` and ``last``.

    Like keys are looked for all along the run, with drawings between them to compare with. ``hidden`` drawings, and
    those between the two keys, are not looked at.
    """
    apart = max(last - first, 2)
    closed = set(range(first + 1, last)) | set((hidden if hidden is not None else np.zeros(0, int)).tolist())
    cases = [
        (start, middle)
        for start in range(1, len(drawings) - apart - 1)
        if drawings.passage[start - 1] == drawings.passage[start + apart + 1]
        for middle in range(start + 1, start + apart)
        if not closed & {start - 1, start, middle, start + apart, start + apart + 1}
    ]
    if len(cases) > MOST_CASES:
        cases = [cases[k] for k in np.linspace(0, len(cases) - 1, MOST_CASES).round().astype(int)]
    missed: dict[str, list[np.ndarray]] = {kind: [] for kind in KINDS}
    bulges: dict[str, list[np.ndarray]] = {kind: [] for kind in KINDS}
    poses = bones_of(tree, drawings.vertices) if cases else None
    for start, middle in cases:
        assert poses is not None
        rows = [start - 1, start, start + apart, start + apart + 1, middle]
        _learn(poses[rows], drawings.times[rows], missed, bulges)
    prior = PRIOR if drawings.is_ordered else 0.0
    return {kind: _strength(missed[kind], bulges[kind], prior) for kind in KINDS}


def _learn(
    found: Bones,
    instants: Float[np.ndarray, "5"],
    missed: dict[str, list[np.ndarray]],
    bulges: dict[str, list[np.ndarray]],
) -> None:
    """Add one case, four keys and the drawing between: what the chord misses of it, and the curve's bulge there."""
    keys, target = unwound(found[:4]), found[4:]
    times = Times(*instants[:4].tolist())
    share = (float(instants[4]) - times.first) / (times.last - times.first)
    for kind in KINDS:
        a, b, c, d = getattr(keys, kind)
        away = getattr(target, kind)[0] - chord(b, c, share)
        missed[kind].append((wrapped(away) if kind == "turns" else away).reshape(-1))
        bulges[kind].append(bulge((a, b, c, d), times, share).reshape(-1))


def _strength(missed: list[np.ndarray], bulges: list[np.ndarray], prior: float) -> float:
    return fitted_strength(np.stack(missed), np.stack(bulges), prior) if missed else prior


def _along(bones: Bones, times: Times, shares: Float[np.ndarray, "N"], strengths: Strengths) -> Bones:
    """Mix bones along chords, bent by their strengths."""
    mixed = {}
    for kind in KINDS:
        a, b, c, d = getattr(bones, kind)
        strength = strengths.get(kind, 0.0)
        rows = [chord(b, c, share) + strength * bulge((a, b, c, d), times, share) for share in shares.tolist()]
        mixed[kind] = np.stack(rows) if rows else np.zeros((0, *b.shape))
    return Bones(**mixed)


def _by_codes(keys: Keys, shares: Float[np.ndarray, "N"], codes: Codes | None) -> Float[np.ndarray, "N V 2"]:
    if codes is None:
        raise ValueError("method code: expected codes")
    ends = codes.decode(np.stack([codes.first, codes.last]), np.array([0.0, 1.0]))
    missed = keys.vertices[1:3] - ends
    mixed = codes.decode(np.stack([chord(codes.first, codes.last, share) for share in shares.tolist()]), shares)
    return np.asarray(mixed + np.stack([chord(missed[0], missed[1], share) for share in shares.tolist()]))
