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
from wildpuppet.puppet.imports.limits import MOST_PARTS, number

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
    """A bone in the setup pose: its parent's index (-1: none) and its matrix."""

    name: str
    parent: int
    armature_from_bone: Affine


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
    matrices: dict[int, Affine] = {}
    waiting = list(range(len(entries)))
    while waiting:
        ready = [bone for bone in waiting if parents[bone] < 0 or parents[bone] in matrices]
        if not ready:
            raise PuppetError(f"{where}: bone {entries[waiting[0]]['name']!r} is its own ancestor")
        for bone in ready:
            matrices[bone] = _global(entries[bone], matrices.get(parents[bone]), where)
        waiting = [bone for bone in waiting if bone not in matrices]
    return [Bone(entry["name"], parents[place], matrices[place]) for place, entry in enumerate(entries)]


def _parent(entry: dict[str, Any], index: dict[str, int], where: str) -> int:
    parent = entry.get("parent")
    if parent in (None, ""):
        return -1
    if parent not in index:
        raise PuppetError(f"{where}: bone {entry['name']!r} has the unknown parent {str(parent)[:40]!r}")
    return index[parent]


def _global(entry: dict[str, Any], parent: Affine | None, where: str) -> Affine:
    own = read_transform(entry.get("transform"), f"{where}: bone {entry['name']!r}")
    if parent is None:
        return own.matrix()
    translated = entry.get("inheritTranslation", True)
    rotated, scaled = entry.get("inheritRotation", True), entry.get("inheritScale", True)
    place = parent @ (own.x, own.y, 1.0) if translated else np.array([own.x, own.y])
    turn, second = own.turn, own.second_turn
    if scaled:
        if not rotated:
            turn, second = turn - _turn(parent), second - _turn(parent)
        axes = parent[:, :2] @ Transform(0.0, 0.0, turn, second, own.scale_x, own.scale_y).matrix()[:, :2]
        return np.column_stack([axes, place])
    if rotated:
        # Without the parent's scale: angles add up, and a mirrored parent turns the other way round.
        skew = second - turn
        mirrored = float(np.linalg.det(parent[:, :2])) < 0.0
        turn = _turn(parent) + (-turn if mirrored else turn)
        second = turn + skew + (math.pi if mirrored and entry.get("inheritReflection", True) else 0.0)
    axes = Transform(0.0, 0.0, turn, second, own.scale_x, own.scale_y).matrix()[:, :2]
    return np.column_stack([axes, place])


def _turn(matrix: Affine) -> float:
    """Measure the angle of a matrix's first axis."""
    return math.atan2(matrix[1, 0], matrix[0, 0])
