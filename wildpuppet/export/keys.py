"""Keys of game rigs: a drawing that is held is one stepped key, one that lasts a frame leads on to the next.

Rigs have bones and meshes, so the window that follows the character becomes a moving bone and the mesh is keyed in
the window's own pixels: while a drawing is held under a moving camera, the mesh has one key.
"""

from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wildpuppet.export.animation import Animation
from wildpuppet.export.pieces import joint_names, joint_places


class Key(NamedTuple):
    """Frame index at which a value is reached, frames that it lasts, and whether it then glides to the next key."""

    at: int
    duration: int
    is_gliding: bool


class Segment(NamedTuple):
    """A span of frame indices that is an animation of its own; ``end`` is not included."""

    name: str
    start: int
    end: int


def segments(animation: Animation, most_frames: int) -> list[Segment]:
    """Cut at the shots, and shots longer than ``most_frames`` into even pieces.

    They are named NAME, NAME_shot2, NAME_shot2_part3.
    """
    starts = [*animation.shot_starts, len(animation)]
    found = []
    for shot, (start, end) in enumerate(pairwise(starts), 1):
        name = animation.name if len(starts) == 2 else f"{animation.name}_shot{shot}"
        count = -(-(end - start) // most_frames)
        bounds = [start + (end - start) * piece // count for piece in range(count + 1)]
        for part, (first, last) in enumerate(pairwise(bounds), 1):
            found.append(Segment(name if count == 1 else f"{name}_part{part}", first, last))
    return found


def keys(values: Sequence[object], segment: Segment, cuts: Collection[int] = ()) -> Iterator[Key]:
    """Give the keys of a track inside a segment: a new one where its value changes.

    A value that lasts more than a frame is held (stepped), and so are the last one and one before a cut.
    """
    changes = [t for t in range(segment.start + 1, segment.end) if values[t] != values[t - 1]]
    for start, end in pairwise([segment.start, *changes, segment.end]):
        yield Key(start, end - start, end - start == 1 and end < segment.end and end not in cuts)


def shown_poses(animation: Animation) -> list[int]:
    """Give each frame's pose, that of the frame before where the character is lost: a hidden mesh needs no keys."""
    poses: list[int] = []
    for pose, is_visible in zip(animation.pose.tolist(), animation.is_visible.tolist(), strict=True):
        poses.append(pose if is_visible or not poses else poses[-1])
    return poses


class Joint(NamedTuple):
    """A hinge: its name, its place at rest, and its places frame by frame in the window's pixels."""

    name: str
    rest: Float[np.ndarray, "2"]
    crop: Float[np.ndarray, "T 2"]


def joints(animation: Animation) -> list[Joint]:
    """Give every hinge, midway between its two points, named after its parts."""
    puppet = animation.puppet
    rest = joint_places(puppet, puppet.vertices.astype(np.float64))
    every = np.stack([joint_places(puppet, vertices.astype(np.float64)) for vertices in animation.vertices_crop])
    return [Joint(name, rest[j], every[:, j]) for j, name in enumerate(joint_names(puppet))]


def unique(names: Sequence[str], taken: Sequence[str] = ()) -> list[str]:
    """Number the names that come again."""
    used, found = set(taken), []
    for name in names:
        chosen, number = name, 1
        while chosen in used:
            number += 1
            chosen = f"{name} {number}"
        used.add(chosen)
        found.append(chosen)
    return found
