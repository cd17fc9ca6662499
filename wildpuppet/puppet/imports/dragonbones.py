"""DragonBones rigs (``NAME_ske.json``, data versions 4 to 6, with ``NAME_tex.json`` and its picture), setup pose.

Every slot that shows a picture or a mesh is a part, in the slots' order, drawn where the bones of the setup pose put
it. A bone's origin is the hinge between its part and the part of the nearest bone above it. Inverse kinematics is not
applied, other displays of a slot and nested armatures are told in the notes.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.dragonbones_atlas import Texture, Textures
from wildpuppet.puppet.imports.dragonbones_mesh import Mesh, read_mesh
from wildpuppet.puppet.imports.dragonbones_pose import Affine, Bone, read_bones, read_transform
from wildpuppet.puppet.imports.limits import MOST_PARTS, Rgba, listed, number, read_json, require_canvas
from wildpuppet.puppet.imports.limits import shown as word_for
from wildpuppet.puppet.imports.paint import paint_mesh, paint_picture
from wildpuppet.puppet.imports.result import Imported, Layer, assembled, own_name
from wildpuppet.types import JointSpec

MARGIN = 8
"""Empty canvas pixels around the drawn armature."""
NEAR = 0.05
"""A hinge lies on a part that is at most this share of the canvas's larger side away."""


@dataclass(frozen=True, eq=False)
class _Shown:
    """What one slot shows in the setup pose: a mesh in armature coordinates, or a picture and where it lies."""

    name: str
    bone: int
    texture: Texture
    tint: Float[np.ndarray, "4"]
    armature_from_picture: Affine
    mesh: Mesh | None

    def corners(self) -> Float[np.ndarray, "N 2"]:
        """Give points that hold everything drawn between them."""
        if self.mesh is not None:
            return self.mesh.vertices
        height, width = self.texture.rgba.shape[:2]
        box = np.array([(0.0, 0.0, 1.0), (width, 0.0, 1.0), (0.0, height, 1.0), (width, height, 1.0)])
        found: Float[np.ndarray, "N 2"] = box @ self.armature_from_picture.T
        return found


def skeleton_in(folder: Path) -> Path | None:
    """Find the one skeleton file of a folder, None where there is none."""
    found = sorted(folder.glob("*_ske.json"))
    if len(found) > 1:
        raise PuppetError(f"{folder}: {len(found)} skeletons ({found[0].name}, {found[1].name}, ...); name one of them")
    return found[0] if found else None


def read_dragonbones(path: Path) -> Imported:
    """Read a rig's setup pose; of several armatures the one with most slots.

    Raises:
        PuppetError: an old or foreign version, a missing picture, a broken skeleton.
    """
    if path.is_dir():
        found = skeleton_in(path)
        if found is None:
            raise PuppetError(f"{path}: no DragonBones skeleton (*_ske.json) in it")
        path = found
    tree = read_json(path)
    notes: list[str] = []
    armature = _armature(tree, path, notes)
    where = f"{path}: armature {armature.get('name')!r}"
    bones = read_bones(armature.get("bone"), where)
    if armature.get("ik"):
        notes.append("inverse kinematics is not applied: limbs stand as their bones do")
    shown = list(_shown(armature, bones, Textures(path, tree.get("textureAtlas")), where, notes))
    if not shown:
        raise PuppetError(f"{where}: no slot shows a picture in the setup pose")
    points = np.concatenate([slot.corners() for slot in shown])
    low = np.floor(points.min(axis=0)) - MARGIN
    size = np.ceil(points.max(axis=0)) + MARGIN - low
    if not np.isfinite(size).all() or size.max() > 1e6:
        raise PuppetError(f"{where}: its drawing is {size.max():.0f} pixels large; that is no usable rig")
    canvas = (int(size[0]), int(size[1]))
    require_canvas(canvas, len(shown), where)
    notes.append(f"the rig's origin stands at {-low[0]:g},{-low[1]:g} on the canvas")
    # Parts of one bone belong together: where no hinge is known between them, one is guessed there first.
    layers = [Layer(slot.name, _painted(slot, low, canvas), (0, 0), (bones[slot.bone].name,)) for slot in shown]
    hinges = _hinges(shown, layers, bones, low)
    return assembled(canvas, layers, notes, str(path), joints=hinges)


def _armature(tree: dict[str, Any], path: Path, notes: list[str]) -> dict[str, Any]:
    version = str(tree.get("compatibleVersion") or tree.get("version") or "")
    if version[:1] not in ("4", "5", "6"):
        raise PuppetError(f"{path}: DragonBones data of version {version[:20]!r}; export it as 4.0 or newer")
    armatures = tree.get("armature")
    if not isinstance(armatures, list) or not armatures or not all(isinstance(entry, dict) for entry in armatures):
        raise PuppetError(f"{path}: expected a list 'armature'; is this a DragonBones skeleton?")
    chosen: dict[str, Any] = max(armatures, key=lambda entry: len(listed(entry.get("slot"))))
    if len(armatures) > 1:
        notes.append(f"of {len(armatures)} armatures {chosen.get('name')!r} is taken, which has most slots")
    return chosen


def _shown(
    armature: dict[str, Any], bones: list[Bone], textures: Textures, where: str, notes: list[str]
) -> list[_Shown]:
    slots = armature.get("slot")
    if not isinstance(slots, list) or len(slots) > MOST_PARTS:
        raise PuppetError(f"{where}: expected a list of slots, at most {MOST_PARTS}")
    index = {bone.name: place for place, bone in enumerate(bones)}
    displays = _displays(armature, where)
    taken: set[str] = set()
    found = []
    for slot in slots:
        name = slot.get("name") if isinstance(slot, dict) else None
        if not isinstance(name, str) or str(slot.get("parent")) not in index:
            raise PuppetError(f"{where}: slot {word_for(name)} has no name or hangs on no bone")
        display = _display(slot, displays.get(name, []), notes)
        if display is not None:
            bone = index[str(slot["parent"])]
            found.append(_slot(own_name(name, taken), bone, slot, display, displays, bones, textures, where))
    return found


def _displays(armature: dict[str, Any], where: str) -> dict[str, list[dict[str, Any]]]:
    """Collect each slot's displays; the first skin that knows a slot counts."""
    found: dict[str, list[dict[str, Any]]] = {}
    for skin in listed(armature.get("skin")):
        for slot in listed(skin.get("slot")) if isinstance(skin, dict) else []:
            if isinstance(slot, dict) and isinstance(slot.get("display"), list):
                entries = [entry if isinstance(entry, dict) else {} for entry in slot["display"]]
                found.setdefault(str(slot.get("name")), entries)
    if not found:
        raise PuppetError(f"{where}: no skin with displays in it")
    return found


def _display(slot: dict[str, Any], displays: list[dict[str, Any]], notes: list[str]) -> dict[str, Any] | None:
    """Choose what a slot shows in the setup pose; None for nothing that can be drawn."""
    name, index = slot["name"], slot.get("displayIndex", 0)
    color = slot.get("color")
    alpha = color.get("aM", 100) if isinstance(color, dict) else 100
    if not isinstance(index, int) or not 0 <= index < len(displays) or alpha == 0:
        notes.append(f"slot {name!r} shows nothing in the setup pose and is left out")
        return None
    if len(displays) > 1:
        notes.append(f"slot {name!r}: display {index} of {len(displays)} is taken")
    if slot.get("blendMode") not in (None, "normal"):
        notes.append(f"slot {name!r} is blended by {str(slot['blendMode'])[:20]}; its plain colours are taken")
    display = displays[index]
    if display.get("type", "image") not in ("image", "mesh", 0, 2):
        notes.append(f"slot {name!r} shows a {str(display['type'])[:20]}, which is left out")
        return None
    return display


def _slot(
    name: str,
    bone: int,
    slot: dict[str, Any],
    display: dict[str, Any],
    displays: dict[str, list[dict[str, Any]]],
    bones: list[Bone],
    textures: Textures,
    where: str,
) -> _Shown:
    where = f"{where}: slot {name!r}"
    texture = textures.find(str(display.get("path") or display.get("name")), where)
    own = read_transform(display.get("transform"), where).matrix()
    from_display = bones[bone].armature_from_bone @ np.vstack([own, [0.0, 0.0, 1.0]])
    height, width = texture.rgba.shape[:2]
    mesh = None
    if display.get("type") in ("mesh", 2):
        mesh = read_mesh(_shared(display, displays, where), bones, bone, from_display, (width, height), where)
    pivot = display.get("pivot")
    pivot = pivot if isinstance(pivot, dict) else {}
    x, y = (number(pivot.get(axis, 0.5), f"{where}: pivot") for axis in ("x", "y"))
    scale = texture.scale
    display_from_picture = np.array([[scale, 0.0, -x * width * scale], [0.0, scale, -y * height * scale], [0, 0, 1.0]])
    holder = bone if mesh is None else mesh.bone
    return _Shown(name, holder, texture, _tint(slot, where), from_display @ display_from_picture, mesh)


def _shared(display: dict[str, Any], displays: dict[str, list[dict[str, Any]]], where: str) -> dict[str, Any]:
    """Find the mesh that a display shares."""
    share = display.get("share")
    if not share:
        return display
    for entries in displays.values():
        for entry in entries:
            if entry is not display and entry.get("name") == share and "vertices" in entry:
                return entry
    raise PuppetError(f"{where}: shares the mesh {str(share)[:40]!r}, which is not there")


def _tint(slot: dict[str, Any], where: str) -> Float[np.ndarray, "4"]:
    color = slot.get("color")
    fields = color if isinstance(color, dict) else {}
    shares = [number(fields.get(key, 100), f"{where}: color {key}") / 100.0 for key in ("rM", "gM", "bM", "aM")]
    return np.array([min(max(share, 0.0), 1.0) for share in shares])


def _painted(slot: _Shown, low: Float[np.ndarray, "2"], canvas: tuple[int, int]) -> Rgba:
    if slot.mesh is None:
        canvas_from_picture = slot.armature_from_picture.copy()
        canvas_from_picture[:, 2] -= low
        rgba = paint_picture(slot.texture.rgba, canvas_from_picture, canvas)
    else:
        mesh = slot.mesh
        rgba = paint_mesh(slot.texture.rgba, mesh.vertices - low, mesh.uv, mesh.triangles, canvas)
    if (slot.tint != 1.0).any():
        rgba = np.asarray(np.rint(rgba * slot.tint), np.uint8)
    return rgba


def _hinges(
    shown: list[_Shown], layers: list[Layer], bones: list[Bone], low: Float[np.ndarray, "2"]
) -> list[JointSpec]:
    """Tie each bone's largest part to the part above it, at the bone's origin; bones named a_to_b tie a and b."""
    largest: dict[int, int] = {}
    size = [np.count_nonzero(layer.rgba[..., 3]) for layer in layers]
    for part in sorted(range(len(shown)), key=lambda part: size[part]):
        largest[shown[part].bone] = part
    number = {layer.name: part for part, layer in enumerate(layers)}
    hinges = []
    for index, bone in enumerate(bones):
        at = bone.armature_from_bone[:, 2] - low
        ends = [number[name] for name in bone.name.split("_to_") if name in number]
        if index in largest:
            above = bone.parent
            while above >= 0 and above not in largest:
                above = bones[above].parent
            ends = [largest[above], largest[index]] if above >= 0 else []
        if len(ends) == 2 and ends[0] != ends[1]:
            hinges.append(_hinge(layers[ends[0]], layers[ends[1]], at))
    return hinges


def _hinge(upper: Layer, lower: Layer, at: Float[np.ndarray, "2"]) -> JointSpec:
    """Keep a bone's origin as hinge where it lies on or near both parts; else the build places it."""
    reach = NEAR * max(upper.rgba.shape[:2])
    for layer in (upper, lower):
        rows, columns = np.nonzero(layer.rgba[..., 3])
        if not len(rows) or np.hypot(columns + 0.5 - at[0], rows + 0.5 - at[1]).min() > reach:
            return JointSpec((upper.name, lower.name))
    return JointSpec((upper.name, lower.name), (float(at[0]), float(at[1])))
