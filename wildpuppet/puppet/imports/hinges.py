"""Guess which parts hang together where a file does not say: the build then places each hinge at the overlap.

Layered pictures hold no skeleton. Parts that overlap are candidates, and the best tree of them wins: a joint's overlap
is large against the smaller part, and parts rather hang on a large part than on a small one. Parts of one group belong
together first. On ten puppets whose joints are known this finds four joints of five; the rest is for the person.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from wildpuppet.puppet.complete import grow
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import JointSpec, Part

TOUCH_PIXELS = 1
"""Every part is grown by so much before overlaps are measured: parts that only touch count too."""
GROUP_WORTH = 10.0
"""Each group in common weighs as much as an overlap so many times larger."""

_LEAST_ALPHA = PuppetSettings().least_alpha


@dataclass(frozen=True, eq=False)
class _Area:
    """Where a part is drawn, grown by the touching distance: a mask inside a window of the canvas, and its pixels."""

    mask: Bool[np.ndarray, "H W"]
    corner: tuple[int, int]
    size: int


def completed(
    parts: Sequence[Part], given: Sequence[JointSpec], groups: Sequence[tuple[str, ...]]
) -> tuple[tuple[JointSpec, ...], tuple[str, ...]]:
    """Add guessed hinges until parts that touch hang together; give all hinges and what to tell about the guess."""
    areas = [_area(part) for part in parts]
    number = {part.name: index for index, part in enumerate(parts)}
    tied = [(number[joint.parts[0]], number[joint.parts[1]]) for joint in given]
    labels = _pieces(len(parts), tied)
    guessed: list[tuple[int, int]] = []
    for _, a, b in sorted(_candidates(areas, groups), reverse=True):
        if labels[a] != labels[b]:
            labels = np.where(labels == labels[b], labels[a], labels)
            guessed.append((a, b))
    hinges = (*given, *(JointSpec((parts[a].name, parts[b].name)) for a, b in sorted(guessed)))
    notes = []
    if guessed:
        what = "no hinge is in the file" if not given else "the file's hinges do not tie all parts"
        notes.append(f"{what}: {len(guessed)} guessed from overlaps; look at overlay.png and mend puppet.json")
    if len(set(labels.tolist())) > 1:
        notes.append("some parts touch no others and hang on nothing; draw them until they overlap, or add joints")
    return hinges, tuple(notes)


def _candidates(areas: Sequence[_Area], groups: Sequence[tuple[str, ...]]) -> list[tuple[float, int, int]]:
    found = []
    for a, b in combinations(range(len(areas)), 2):
        worth = _worth(areas[a], areas[b])
        if worth > 0.0:
            in_common = next(
                (depth for depth, (one, other) in enumerate(zip(groups[a], groups[b], strict=False)) if one != other),
                min(len(groups[a]), len(groups[b])),
            )
            found.append((worth * GROUP_WORTH**in_common, a, b))
    return found


def _worth(a: _Area, b: _Area) -> float:
    """Say how much an overlap looks like a joint; 0 where the parts do not touch."""
    left, top = max(a.corner[0], b.corner[0]), max(a.corner[1], b.corner[1])
    right = min(a.corner[0] + a.mask.shape[1], b.corner[0] + b.mask.shape[1])
    bottom = min(a.corner[1] + a.mask.shape[0], b.corner[1] + b.mask.shape[0])
    if right <= left or bottom <= top:
        return 0.0
    shared = a.mask[_within(a, left, top, right, bottom)] & b.mask[_within(b, left, top, right, bottom)]
    small, large = sorted((a.size, b.size))
    return float(np.count_nonzero(shared) * large**0.25 / small**0.5)


def _within(area: _Area, left: int, top: int, right: int, bottom: int) -> tuple[slice, slice]:
    x, y = area.corner
    return slice(top - y, bottom - y), slice(left - x, right - x)


def _area(part: Part) -> _Area:
    covered = part.rgba[..., 3] >= _LEAST_ALPHA
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    top, left = int(rows[0]), int(columns[0])
    window = np.pad(covered[top : rows[-1] + 1, left : columns[-1] + 1], TOUCH_PIXELS)
    grown = grow(window, TOUCH_PIXELS)
    return _Area(grown, (left - TOUCH_PIXELS, top - TOUCH_PIXELS), int(np.count_nonzero(grown)))


def _pieces(count: int, tied: Sequence[tuple[int, int]]) -> Int[np.ndarray, "L"]:
    ends = np.array(tied, np.int64).reshape(-1, 2)
    graph = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels, np.int64)
