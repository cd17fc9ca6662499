"""DragonBones' meshes in the setup pose: free ones move with their slot, weighted ones with several bones."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.dragonbones_pose import Affine, Bone
from wildpuppet.puppet.imports.limits import FARTHEST, MOST_POINTS


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh in armature coordinates, ``uv`` in the picture's pixels, and the bone that holds most of it."""

    vertices: Float[np.ndarray, "V 2"]
    uv: Float[np.ndarray, "V 2"]
    triangles: Int[np.ndarray, "F 3"]
    bone: int


def read_mesh(
    display: dict[str, Any], bones: list[Bone], bone: int, from_display: Affine, size: tuple[int, int], where: str
) -> Mesh:
    """Read a mesh display and put it into the setup pose; ``size`` is its picture's."""
    vertices = _numbers(display.get("vertices"), f"{where}: vertices").reshape(-1, 2)
    uv = _numbers(display.get("uvs"), f"{where}: uvs").reshape(-1, 2) * size
    flat = _numbers(display.get("triangles"), f"{where}: triangles", 3)
    triangles = flat.astype(np.int64).reshape(-1, 3)
    if len(uv) != len(vertices) or not len(triangles) or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise PuppetError(f"{where}: its mesh's uvs or triangles do not fit its {len(vertices)} vertices")
    homogeneous = np.column_stack([vertices, np.ones(len(vertices))])
    if not display.get("weights"):
        return Mesh(homogeneous @ from_display.T, uv, triangles, bone)
    slot_pose = _matrix(_numbers(display.get("slotPose"), f"{where}: slotPose", 6)[:6])
    poses = _numbers(display.get("bonePose"), f"{where}: bonePose", 7).reshape(-1, 7)
    armature_from_bind = {int(pose[0]): _inverse(_matrix(pose[1:]), where) for pose in poses}
    bound = np.column_stack([homogeneous @ slot_pose.T, np.ones(len(vertices))])
    shares = _shares(display["weights"], len(vertices), set(armature_from_bind), len(bones), where)
    moved = np.zeros_like(vertices)
    for index, share in shares.items():
        local = np.column_stack([bound @ armature_from_bind[index].T, np.ones(len(vertices))])
        moved += share[:, None] * (local @ bones[index].armature_from_bone.T)
    heaviest = max(shares, key=lambda index: float(shares[index].sum()))
    return Mesh(moved, uv, triangles, heaviest)


def _shares(
    value: object, num_vertices: int, known: set[int], num_bones: int, where: str
) -> dict[int, Float[np.ndarray, "V"]]:
    """Unpack weights: for each vertex a count, then so many pairs of a bone and its share."""
    flat = _numbers(value, f"{where}: weights")
    shares: dict[int, Float[np.ndarray, "V"]] = {}
    place = 0
    for vertex in range(num_vertices):
        count = int(flat[place]) if place < len(flat) else -1
        if count < 0 or place + 1 + 2 * count > len(flat):
            raise PuppetError(f"{where}: its weights end before its vertices do")
        for index, share in flat[place + 1 : place + 1 + 2 * count].reshape(-1, 2):
            if int(index) not in known or not 0 <= int(index) < num_bones:
                raise PuppetError(f"{where}: its weights name bone {int(index)}, which has no bonePose")
            shares.setdefault(int(index), np.zeros(num_vertices))[vertex] += share
        place += 1 + 2 * count
    if not shares:
        raise PuppetError(f"{where}: its weights name no bone")
    return shares


def _numbers(value: object, where: str, multiple: int = 1) -> Float[np.ndarray, "N"]:
    """Read a flat list of finite numbers of bounded length."""
    if not isinstance(value, list) or len(value) > 100 * MOST_POINTS or len(value) % multiple or not value:
        raise PuppetError(f"{where}: expected a list of numbers")
    try:
        numbers = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.zeros((0, 0))
    if numbers.ndim != 1 or not (np.abs(numbers) <= FARTHEST).all():
        raise PuppetError(f"{where}: expected a flat list of finite numbers")
    return numbers


def _matrix(six: Float[np.ndarray, "6"]) -> Affine:
    """Give [a, b, c, d, tx, ty] as a matrix."""
    return np.array([[six[0], six[2], six[4]], [six[1], six[3], six[5]]])


def _inverse(matrix: Affine, where: str) -> Affine:
    if abs(np.linalg.det(matrix[:, :2])) < 1e-12:
        raise PuppetError(f"{where}: a bonePose has no inverse")
    linear = np.linalg.inv(matrix[:, :2])
    return np.column_stack([linear, -linear @ matrix[:, 2]])
