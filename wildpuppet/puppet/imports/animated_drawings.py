"""Character folders of AnimatedDrawings: ``char_cfg.yaml`` (a skeleton), ``texture.png`` and ``mask.png``.

Such a character is one flat picture with joints. It is cut into parts here: every pixel of the mask goes to the bone
that is nearest along the drawing (not across a gap), the bones between branching points make the trunk, and at every
joint both parts keep a disc, so that bending opens no gap. Nothing is hidden in such a picture: nothing is completed.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import MOST_PARTS, needed, number, open_picture, place, read_picture, read_text
from wildpuppet.puppet.imports.result import Imported, Layer, assembled, own_name
from wildpuppet.types import JointSpec

CONFIG = "char_cfg.yaml"
TRUNK = "trunk"

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
    areas = _areas(mask, bones, joints)
    kept, specs = _with_overlaps(areas, names, hinges, joints, mask)
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
    if "&" in text and "*" in text:
        raise PuppetError(f"{path}: YAML anchors and aliases are refused; write the values out")
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
            raise PuppetError(f"{path}: every joint needs a name of its own; found {str(name)[:40]!r}")
        parent = entry.get("parent")
        if parent is not None and parent not in index:
            raise PuppetError(f"{path}: joint {name!r} has the parent {str(parent)[:40]!r}, which is not above it")
        if (parent is None) == bool(found):
            raise PuppetError(f"{path}: joint {name!r}: the first joint, and only it, has no parent")
        index[name] = len(found)
        where = f"{path}: joint {name!r} loc"
        found.append(_Joint(name, -1 if parent is None else index[parent], place(entry.get("loc"), where)))
    return found


def _parts(joints: list[_Joint]) -> tuple[list[int], list[str], list[tuple[int, int, int]]]:
    """Sort bones into parts: the part of each bone (by its end joint), names, and hinges (joint, part, part)."""
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
        hinges.append((joint.parent, bones[joint.parent], bones[index]))
    return bones, names, hinges


def _limb_name(end: str, start: str) -> str:
    """Name a limb: AnimatedDrawings names joints, a part is what lies between two of them."""
    sides = {f"{side}_{joint}": f"{side}_{part}" for side in ("left", "right") for joint, part in (
        ("elbow", "upper_arm"), ("hand", "forearm"), ("knee", "thigh"), ("foot", "shin"))}  # fmt: skip
    return {"neck": "head", **sides}.get(end, f"{start}-{end}")


def _areas(mask: Mask, bones: list[int], joints: list[_Joint]) -> Int[np.ndarray, "H W"]:
    """Give every pixel of the mask to the part whose bones are nearest along the drawing; -1 outside."""
    import cv2
    from skimage.segmentation import watershed

    markers = np.zeros(mask.shape, np.int32)
    for index, joint in enumerate(joints[1:], 1):
        ends = [[round((value - 0.5) * 16) for value in end] for end in (joints[joint.parent].at, joint.at)]
        cv2.line(markers, ends[0], ends[1], bones[index] + 1, 1, cv2.LINE_8, shift=4)
    markers[~mask] = 0
    if not markers.any():
        raise PuppetError("the skeleton lies wholly outside the mask; are both of the same character?")
    # A flat landscape is flooded step by step from all bones at once: the nearest along the drawing comes first.
    flood: Any = watershed
    flooded = flood(np.zeros(mask.shape, np.uint8), markers, mask=mask, connectivity=2)
    owner: Int[np.ndarray, "H W"] = np.asarray(flooded, np.int64) - 1
    return owner


def _with_overlaps(
    owner: Int[np.ndarray, "H W"],
    names: list[str],
    hinges: list[tuple[int, int, int]],
    joints: list[_Joint],
    mask: Mask,
) -> tuple[list[tuple[str, Mask]], list[JointSpec]]:
    """Let both parts of a hinge keep the disc around it that the drawing has room for."""
    from scipy.ndimage import distance_transform_edt

    thickness = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    y, x = np.indices(mask.shape) + 0.5
    areas = {part: owner == part for part in range(len(names))}
    specs = []
    for joint, *ends in hinges:
        at = joints[joint].at
        if not all(areas[end].any() for end in ends):
            continue
        disc = mask & (np.hypot(x - at[0], y - at[1]) <= _room(at, thickness))
        for end in ends:
            areas[end] = areas[end] | disc
        specs.append(JointSpec((names[ends[0]], names[ends[1]]), at))
    return [(names[part], area) for part, area in areas.items() if area.any()], specs


def _room(at: tuple[float, float], thickness: Float[np.ndarray, "H W"]) -> float:
    """Measure half the drawing's thickness at a joint; at least two pixels."""
    height, width = thickness.shape
    row, column = min(max(int(at[1]), 0), height - 1), min(max(int(at[0]), 0), width - 1)
    return max(float(thickness[row, column]) * 1.1, 2.0)
