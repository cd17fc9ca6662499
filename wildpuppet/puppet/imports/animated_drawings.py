"""Character folders of AnimatedDrawings: ``char_cfg.yaml`` (a skeleton), ``texture.png`` and ``mask.png``.

Such a character is one flat picture with joints. It is cut into parts here: every pixel of the mask goes to the nearest
bone, in units of the drawing's thickness there; the bones between branching points make the trunk; and at every joint
both parts keep a disc, so that bending opens no gap. Nothing is hidden in such a picture: nothing is completed.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import (
    MOST_PARTS,
    needed,
    number,
    open_picture,
    place,
    read_picture,
    read_text,
    shown,
)
from wildpuppet.puppet.imports.result import Imported, Layer, assembled, own_name
from wildpuppet.types import JointSpec

CONFIG = "char_cfg.yaml"
TRUNK = "trunk"
MOST_CONFIG = 2**20
"""Longest configuration, characters."""
DISC = 1.2
"""Radius of the disc that both parts keep around a joint, in half widths of the drawing there."""

Mask = Bool[np.ndarray, "H W"]


@dataclass(frozen=True, eq=False)
class _Joint:
    """A joint of the skeleton: its parent's index (-1: the root) and its place on the canvas."""

    name: str
    parent: int
    at: tuple[float, float]


def read_animated_drawings(folder: Path) -> Imported:
    """Read a character folder and cut the character into parts at its joints.

    Raises:
        PuppetError: a file is missing or broken, the pictures differ in size, the skeleton is no tree.
    """
    config = folder / CONFIG
    tree = _config(config)
    joints = _skeleton(tree, config)
    rgba = read_picture(folder / "texture.png", str(folder / "texture.png"))
    with open_picture(folder / "mask.png", str(folder / "mask.png")) as image:
        mask = np.array(image.convert("L")) > 127
    height, width = rgba.shape[:2]
    given = (int(number(tree.get("width"), f"{config}: width")), int(number(tree.get("height"), f"{config}: height")))
    if mask.shape != (height, width) or given != (width, height):
        raise PuppetError(
            f"{folder}: texture.png is {width} x {height}, mask.png {mask.shape[1]} x {mask.shape[0]}, {CONFIG} says "
            f"{given[0]} x {given[1]}; all three must be the same"
        )
    if not mask.any():
        raise PuppetError(f"{folder / 'mask.png'}: nothing is white in it; expected the character in white")
    bones, names, hinges = _parts(joints)
    thickness = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    owner = _areas(mask, thickness, bones, joints)
    kept, specs = _with_overlaps(owner, names, hinges, joints, thickness)
    layers = []
    for name, area in kept:
        picture = rgba.copy()
        picture[..., 3] = np.where(area, picture[..., 3], 0)
        layers.append(Layer(name, picture))
    notes = [f"one flat picture: cut into {len(layers)} parts at the joints, the trunk backmost; look at overlay.png"]
    return assembled((width, height), layers, notes, str(folder), joints=specs)


def _config(path: Path) -> dict[str, Any]:
    yaml = needed("yaml", str(path))
    text = read_text(path)
    if "<<" in text or len(text) > MOST_CONFIG:
        raise PuppetError(f"{path}: YAML with merge keys (<<) or of more than {MOST_CONFIG} characters is refused")
    try:
        tree = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise PuppetError(f"{path}: not valid YAML: {' '.join(str(error).split())[:160]}") from None
    if not isinstance(tree, dict):
        raise PuppetError(f"{path}: expected width, height and skeleton, found {type(tree).__name__}")
    return tree


def _skeleton(tree: dict[str, Any], path: Path) -> list[_Joint]:
    """Read the joints, parents before children."""
    entries = tree.get("skeleton")
    if not isinstance(entries, list) or not 2 <= len(entries) <= MOST_PARTS:
        raise PuppetError(f"{path}: expected a skeleton of 2 to {MOST_PARTS} joints")
    found: list[_Joint] = []
    index: dict[str, int] = {}
    for entry in entries:
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not name or name in index:
            raise PuppetError(f"{path}: every joint needs a name of its own; found {shown(name)}")
        parent = entry.get("parent")
        if parent is not None and (not isinstance(parent, str) or parent not in index):
            raise PuppetError(f"{path}: joint {name!r} has the parent {shown(parent)}, which is not above it")
        if (parent is None) == bool(found):
            raise PuppetError(f"{path}: joint {name!r}: the first joint, and only it, has no parent")
        index[name] = len(found)
        where = f"{path}: joint {name!r} loc"
        found.append(_Joint(name, -1 if parent is None else index[parent], place(entry.get("loc"), where)))
    return found


def _parts(joints: list[_Joint]) -> tuple[list[int], list[str], list[tuple[int, int, int]]]:
    """Sort bones into parts: the part of each bone (by its end joint), names, and hinges (end joint, part, part)."""
    children: list[list[int]] = [[] for _ in joints]
    for index, joint in enumerate(joints[1:], 1):
        children[joint.parent].append(index)
    bones, names, hinges = [0] * len(joints), [TRUNK], []
    taken = {TRUNK}
    for index, joint in enumerate(joints[1:], 1):
        starts_at_fork = joint.parent == 0 or len(children[joint.parent]) > 1
        if bones[joint.parent] == 0 and children[index] and (starts_at_fork or len(children[index]) > 1):
            continue  # between the root and a fork, or from a fork to where a limb begins
        if joint.at == joints[joint.parent].at:
            bones[index] = bones[joint.parent]
            continue
        bones[index] = len(names)
        names.append(own_name(_limb_name(joint.name, joints[joint.parent].name), taken))
        hinges.append((index, bones[joint.parent], bones[index]))
    return bones, names, hinges


def _limb_name(end: str, start: str) -> str:
    """Name a limb: AnimatedDrawings names joints, a part is what lies between two of them."""
    sides = {f"{side}_{joint}": f"{side}_{part}" for side in ("left", "right") for joint, part in (
        ("elbow", "upper_arm"), ("hand", "forearm"), ("knee", "thigh"), ("foot", "shin"))}  # fmt: skip
    return {"neck": "head", **sides}.get(end, f"{start}-{end}")


def _areas(
    mask: Mask, thickness: Float[np.ndarray, "H W"], bones: list[int], joints: list[_Joint]
) -> Int[np.ndarray, "H W"]:
    """Give every pixel of the mask to the part whose bone is nearest, measured in the bone's own thickness; -1 outside.

    Islands that such a cut leaves go to the part around them.
    """
    from scipy.ndimage import label
    from skimage.segmentation import watershed

    nearest = np.full(mask.shape, np.inf)
    owner = np.full(mask.shape, -1)
    for index, joint in enumerate(joints[1:], 1):
        ends = joints[joint.parent].at, joint.at
        distance = _from_bone(*ends, mask.shape) / _half_width(*ends, thickness)
        closer = mask & (distance < nearest)
        nearest[closer], owner[closer] = distance[closer], bones[index]
    markers = np.zeros(mask.shape, np.int32)
    for part in set(bones):
        islands, _ = label(owner == part)
        sizes = np.bincount(islands.ravel())[1:]
        if len(sizes):
            markers[islands == 1 + int(sizes.argmax())] = part + 1
    flood: Any = watershed
    flooded = np.asarray(flood(np.zeros(mask.shape, np.uint8), markers, mask=mask), np.int64) - 1
    # An island of the mask that no bone's largest piece reaches stays with its nearest bone.
    return np.where(flooded < 0, owner, flooded)


def _from_bone(
    start: tuple[float, float], end: tuple[float, float], shape: tuple[int, int]
) -> Float[np.ndarray, "H W"]:
    """Measure every pixel's distance to a bone."""
    y, x = np.indices(shape) + 0.5
    along = np.subtract(end, start)
    share = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max(float(along @ along), 1e-9)
    share = np.clip(share, 0.0, 1.0)
    distance: Float[np.ndarray, "H W"] = np.hypot(x - start[0] - share * along[0], y - start[1] - share * along[1])
    return distance


def _half_width(start: tuple[float, float], end: tuple[float, float], thickness: Float[np.ndarray, "H W"]) -> float:
    """Measure half the drawing's thickness along a bone; at least a pixel."""
    height, width = thickness.shape
    samples = np.add(start, np.linspace(0.0, 1.0, 21)[:, None] * np.subtract(end, start)).astype(np.int64)
    columns, rows = np.clip(samples[:, 0], 0, width - 1), np.clip(samples[:, 1], 0, height - 1)
    return max(float(np.median(thickness[rows, columns])), 1.0)


def _with_overlaps(
    owner: Int[np.ndarray, "H W"],
    names: list[str],
    hinges: list[tuple[int, int, int]],
    joints: list[_Joint],
    thickness: Float[np.ndarray, "H W"],
) -> tuple[list[tuple[str, Mask]], list[JointSpec]]:
    """Let both parts of a hinge keep a disc around it, as wide as the limb and as the drawing has room for."""
    mask = owner >= 0
    y, x = np.indices(mask.shape) + 0.5
    areas = {part: owner == part for part in range(len(names))}
    specs = []
    for bone, *ends in hinges:
        at = joints[joints[bone].parent].at
        if not all(areas[end].any() for end in ends):
            continue
        radius = min(_half_width(at, at, thickness), _half_width(at, joints[bone].at, thickness)) * DISC
        disc = mask & (np.hypot(x - at[0], y - at[1]) <= max(radius, 2.0))
        for end in ends:
            areas[end] = areas[end] | disc
        specs.append(JointSpec((names[ends[0]], names[ends[1]]), at))
    return [(names[part], area) for part, area in areas.items() if area.any()], specs
