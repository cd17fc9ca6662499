"""The setup pose of a DragonBones armature: every bone's matrix, by the format's own rules of inheritance.

A transform is x, y, skX, skY (degrees), scX, scY: the first axis is turned by skY, the second by skX. A bone may keep
its parent's rotation, scale or translation off. Matrices are (2, 3), armature from bone; y runs down.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import MOST_PARTS, number, shown

Affine = Float[np.ndarray, "2 3"]


@dataclass(frozen=True)
class Transform:
    """A place, the angles of both axes in radians, and both scales."""

    x: float
    y: float
    turn: float
    second_turn: float
    scale_x: float
    scale_y: float

    def matrix(self) -> Affine:
        """Give the matrix that carries points by this transform."""
        return np.array(
            [
                [math.cos(self.turn) * self.scale_x, -math.sin(self.second_turn) * self.scale_y, self.x],
                [math.sin(self.turn) * self.scale_x, math.cos(self.second_turn) * self.scale_y, self.y],
            ]
        )


@dataclass(frozen=True, eq=False)
class Bone:
    """A bone in the setup pose: its parent's index (-1: none), its matrix and what the format calls its rotation.

    Where a mirrored first axis stays mirrored, that rotation points against the axis.
    """

    name: str
    parent: int
    armature_from_bone: Affine
    turn: float


def read_transform(value: object, where: str) -> Transform:
    """Read a transform; what is left out is the identity."""
    fields = value if isinstance(value, dict) else {}

    def read(name: str, default: float = 0.0) -> float:
        return number(fields.get(name, default), f"{where}: {name}")

    turn = read("rotate") if "rotate" in fields else read("skY")
    second = turn + read("skew") if "rotate" in fields or "skew" in fields else read("skX")
    return Transform(read("x"), read("y"), math.radians(turn), math.radians(second), read("scX", 1.0), read("scY", 1.0))


def read_bones(entries: object, where: str) -> list[Bone]:
    """Read the bones in the file's order, with their matrices in the setup pose.

    Raises:
        PuppetError: a bone without a name of its own, with a parent that is not there, or in a ring.
    """
    if not isinstance(entries, list) or not 1 <= len(entries) <= 4 * MOST_PARTS:
        raise PuppetError(f"{where}: expected a list of bones, at most {4 * MOST_PARTS}")
    if not all(isinstance(entry, dict) and isinstance(entry.get("name"), str) for entry in entries):
        raise PuppetError(f"{where}: every bone needs a name")
    index = {entry["name"]: place for place, entry in enumerate(entries)}
    if len(index) < len(entries):
        raise PuppetError(f"{where}: two bones have the same name")
    parents = [_parent(entry, index, where) for entry in entries]
    found: dict[int, Bone] = {}
    waiting = list(range(len(entries)))
    while waiting:
        ready = [bone for bone in waiting if parents[bone] < 0 or parents[bone] in found]
        if not ready:
            raise PuppetError(f"{where}: bone {entries[waiting[0]]['name']!r} is its own ancestor")
        for bone in ready:
            found[bone] = _placed(entries[bone], parents[bone], found.get(parents[bone]), where)
        waiting = [bone for bone in waiting if bone not in found]
    return [found[bone] for bone in range(len(entries))]


def _parent(entry: dict[str, Any], index: dict[str, int], where: str) -> int:
    parent = entry.get("parent")
    if parent in (None, ""):
        return -1
    if not isinstance(parent, str) or parent not in index:
        raise PuppetError(f"{where}: bone {entry['name']!r} has the unknown parent {shown(parent)}")
    return index[parent]


def _placed(entry: dict[str, Any], index: int, parent: Bone | None, where: str) -> Bone:
    """Put one bone into the setup pose."""
    own = read_transform(entry.get("transform"), f"{where}: bone {entry['name']!r}")
    if parent is None:
        return Bone(entry["name"], index, own.matrix(), own.turn)
    above = parent.armature_from_bone
    place = above @ (own.x, own.y, 1.0) if entry.get("inheritTranslation", True) else np.array([own.x, own.y])
    if entry.get("inheritScale", True):
        back = 0.0 if entry.get("inheritRotation", True) else parent.turn
        axes = above[:, :2] @ _axes(own, own.turn - back, own.second_turn - back)
        turn = _direction(axes) + (math.pi if own.scale_x < 0.0 and axes[0, 0] < 0.0 else 0.0)
        return Bone(entry["name"], index, np.column_stack([axes, place]), turn)
    turn, second = own.turn, own.second_turn
    if entry.get("inheritRotation", True):
        # Without the parent's scale: angles add up, and a mirrored parent turns the other way round.
        mirrored = float(np.linalg.det(above[:, :2])) < 0.0
        turn = _direction(above) + (-own.turn if mirrored else own.turn)
        second = turn + own.second_turn - own.turn
        second += math.pi if mirrored and entry.get("inheritReflection", True) else 0.0
    return Bone(entry["name"], index, np.column_stack([_axes(own, turn, second), place]), turn)


def _axes(own: Transform, turn: float, second_turn: float) -> Float[np.ndarray, "2 2"]:
    return Transform(0.0, 0.0, turn, second_turn, own.scale_x, own.scale_y).matrix()[:, :2]


def _direction(matrix: Float[np.ndarray, "2 N"]) -> float:
    """Measure the angle of a matrix's first axis."""
    return math.atan2(matrix[1, 0], matrix[0, 0])
