"""A skeleton out of the puppet's hinges: a bone per part that hangs on its hinge and turns with the part.

The part with the most hinges is the root of its bones; every other part's bone begins at the hinge that ties it to the
part before it. A bone is where the hinge is and has the turn and the size of its part as a whole (the similarity
nearest to its vertices); what the mesh bends beyond that is left to deform keys. Places are in the window's pixels.
The numbers are rounded here, once, so that meshes can be told exactly what the bones, as written, leave over.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from wildpuppet.export.animation import Animation
from wildpuppet.export.json_stream import DECIMALS
from wildpuppet.export.manifest import PositionError, position_error
from wildpuppet.export.pieces import joint_places
from wildpuppet.export.rig import MeshPart
from wildpuppet.geometry.affine import apply, compose, invert, similarity
from wildpuppet.types import Puppet

ROOT = -1
"""Parent of a bone that hangs on the window."""
TURN_DECIMALS, SCALE_DECIMALS = 6, 8
LEAST_SCALE = 1e-2
"""A part that is nearly gone, or mirrored, still gets a bone that can be undone."""


@dataclass(frozen=True, eq=False)
class Bone:
    """The bone of part ``layer``; ``parent`` is a layer too, ``joint`` the hinge between them (-1: none)."""

    layer: int
    parent: int
    joint: int
    rest: Float[np.ndarray, "2"]
    """Where it begins at rest, canvas pixels."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Bones, parents first, and what they do: turn in degrees (y down: clockwise), size, and place from the parent."""

    bones: tuple[Bone, ...]
    degrees: Float[np.ndarray, "L T"]
    scale: Float[np.ndarray, "L T"]
    shift: Float[np.ndarray, "L T 2"]

    @cached_property
    def crop_from_bone(self) -> Float[np.ndarray, "L T 2 3"]:
        """Each layer's bone in the window, by the numbers as they are written."""
        maps = np.zeros((*self.scale.shape, 2, 3))
        for bone in self.bones:
            layer = bone.layer
            own = similarity(self.scale[layer], np.radians(self.degrees[layer]), self.shift[layer])
            maps[layer] = own if bone.parent == ROOT else compose(maps[bone.parent], own)
        return maps

    def from_parent(self, bone: Bone) -> Float[np.ndarray, "2"]:
        """Place of a bone at rest, from its parent's."""
        return bone.rest if bone.parent == ROOT else bone.rest - self.of(bone.parent).rest

    def of(self, layer: int) -> Bone:
        """Give a layer's bone."""
        return next(bone for bone in self.bones if bone.layer == layer)


def skeleton_of(animation: Animation) -> Skeleton:
    """Fit the bones to every frame."""
    puppet = animation.puppet
    bones = tuple(_hung(puppet))
    crop_from_bone = np.zeros((puppet.num_layers, len(animation), 2, 3))
    places = np.stack([joint_places(puppet, vertices.astype(np.float64)) for vertices in animation.vertices_crop])
    for bone in bones:
        turned = _nearest(animation, bone)
        crop_from_bone[bone.layer] = turned
        if bone.joint >= 0:
            crop_from_bone[bone.layer, :, :, 2] = places[:, bone.joint]
    return _written(bones, crop_from_bone)


def _hung(puppet: Puppet) -> Iterator[Bone]:
    """Walk over the hinges from the part with the most of them, one body after the other."""
    ties: dict[int, list[tuple[int, int]]] = {layer: [] for layer in range(puppet.num_layers)}
    for joint, (a, b) in enumerate(puppet.joint_layers.tolist()):
        ties[a].append((joint, b))
        ties[b].append((joint, a))
    rest = joint_places(puppet, puppet.vertices.astype(np.float64))
    hung: set[int] = set()
    for root in sorted(ties, key=lambda layer: -len(ties[layer])):
        if root in hung:
            continue
        hung.add(root)
        mine = puppet.vertices[puppet.layer_of_vertex == root].astype(np.float64)
        line = [Bone(root, ROOT, -1, np.round(mine.mean(0), DECIMALS))]
        while line:
            bone = line.pop(0)
            yield bone
            for joint, layer in ties[bone.layer]:
                if layer not in hung:
                    hung.add(layer)
                    line.append(Bone(layer, bone.layer, joint, np.round(rest[joint], DECIMALS)))


def _nearest(animation: Animation, bone: Bone) -> Float[np.ndarray, "T 2 3"]:
    """Find the similarity nearest to the part's vertices, frame by frame, as a map of places from the bone's rest."""
    mine = np.flatnonzero(animation.puppet.layer_of_vertex == bone.layer)
    rest = animation.puppet.vertices[mine].astype(np.float64)
    moved = animation.vertices_crop[:, mine].astype(np.float64)
    flat, spread = rest - rest.mean(0), moved - moved.mean(1, keepdims=True)
    size = max(float((flat**2).sum()), 1e-12)
    along = np.einsum("nd,tnd->t", flat, spread) / size
    across = (flat[:, 0] * spread[:, :, 1] - flat[:, 1] * spread[:, :, 0]).sum(1) / size
    scale = np.maximum(np.hypot(along, across), LEAST_SCALE)
    turned = similarity(scale, np.arctan2(across, along), np.zeros((len(moved), 2)))
    turned[:, :, 2] = moved.mean(1) + np.einsum("tij,j->ti", turned[:, :, :2], bone.rest - rest.mean(0))
    return turned


def _written(bones: tuple[Bone, ...], crop_from_bone: Float[np.ndarray, "L T 2 3"]) -> Skeleton:
    """Take each bone apart into numbers relative to its parent, round them, and go on from what was rounded."""
    shape = crop_from_bone.shape[:2]
    degrees, scale, shift = np.zeros(shape), np.ones(shape), np.zeros((*shape, 2))
    found = Skeleton(bones, degrees, scale, shift)
    kept = np.zeros_like(crop_from_bone)
    for bone in bones:
        layer = bone.layer
        own = (
            crop_from_bone[layer] if bone.parent == ROOT else compose(invert(kept[bone.parent]), crop_from_bone[layer])
        )
        turn = np.degrees(np.unwrap(np.arctan2(own[:, 1, 0], own[:, 0, 0])))
        degrees[layer] = np.round(turn, TURN_DECIMALS)
        scale[layer] = np.round(np.hypot(own[:, 0, 0], own[:, 1, 0]), SCALE_DECIMALS)
        shift[layer] = np.round(own[:, :, 2], DECIMALS)
        made = similarity(scale[layer], np.radians(degrees[layer]), shift[layer])
        kept[layer] = made if bone.parent == ROOT else compose(kept[bone.parent], made)
    return found


def bent(skeleton: Skeleton, animation: Animation, part: MeshPart, t: int) -> Float[np.ndarray, "n 2"]:
    """What a part's vertices do beyond its bone: their offsets from rest, in the bone's own pixels."""
    layer = int(animation.puppet.layer_of_vertex[part.corners[0]])
    bone_from_crop = invert(skeleton.crop_from_bone[layer, t])
    now = apply(bone_from_crop, animation.vertices_crop[t][part.corners].astype(np.float64))
    return np.asarray(now - (part.vertices - skeleton.of(layer).rest))


def written_error(skeleton: Skeleton, animation: Animation, parts: Sequence[MeshPart]) -> PositionError:
    """Measure what is lost where meshes, offsets and window are written with ``DECIMALS`` (its size with 7)."""

    def distances() -> Iterator[Float[np.ndarray, "_"]]:
        for t in range(len(animation)):
            window = animation.video_from_crop[t]
            kept = np.column_stack([np.round(window[:, :2], 7), np.round(window[:, 2], DECIMALS)])
            for layer, part in enumerate(parts):
                rest = np.round(part.vertices - skeleton.of(layer).rest, DECIMALS)
                own = rest + np.round(bent(skeleton, animation, part, t), DECIMALS)
                placed = apply(compose(kept, skeleton.crop_from_bone[layer, t]), own)
                yield np.linalg.norm(placed - animation.vertices(t)[part.corners], axis=1)

    return position_error(distances(), "the numbers as written")
