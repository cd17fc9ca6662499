"""Spine 4.2: NAME.json, NAME.atlas, NAME.png; y up, zero at the picture's lower left corner.

Bones: ``window``, which follows the character through the picture, and under it one per part, each hung on its hinge
(``export/bones.py``). One slot per part on its bone, with a mesh whose bending is in deform keys; draw order;
attachments that go away where the character is lost; an event ``shot`` at each cut. Times are exact to the microsecond,
so a variable frame rate is kept. At rest the puppet stands as it was drawn.

The format asks for the outline's corners first, in their order; of a mesh with holes or islands the longest outline
counts. Files are written after the published format; reading them in a product takes a Spine licence of your own.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from wildpuppet.export.animation import Animation
from wildpuppet.export.bones import ROOT, Bone, Skeleton, bent, skeleton_of, written_error
from wildpuppet.export.json_stream import write_json
from wildpuppet.export.keys import Key, Segment, keys, shown_poses, unique
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.export.rig import MeshPart, hull_first, loops, mesh_parts
from wildpuppet.machine import Progress

VERSION = "4.2.43"
WINDOW = "window"
UP = np.array([1.0, -1.0])


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write the three files."""
    stem = file_names([animation.name])[0]
    parts, skeleton = [hull_first(part) for part in mesh_parts(animation.puppet)], skeleton_of(animation)
    Image.fromarray(animation.puppet.atlas).save(folder / f"{stem}.png")
    (folder / f"{stem}.atlas").write_text(_atlas(animation, parts, stem), encoding="utf-8")
    with (folder / f"{stem}.json").open("w", encoding="utf-8") as file:
        write_json(file, _tree(animation, parts, skeleton, progress))
    holed = [part.name for part in parts if len(loops(part.edges)) > 1]
    left_out = [f"outlines of holes and islands, in the editor: {', '.join(holed)}"] if holed else []
    error = written_error(skeleton, animation, parts)
    return Manifest("bottom left corner of the picture", "x right, y up, pixels", 0, 1.0, tuple(left_out), error)


def _regions(parts: Sequence[MeshPart]) -> tuple[str, ...]:
    return file_names([part.name for part in parts])


def _atlas(animation: Animation, parts: Sequence[MeshPart], stem: str) -> str:
    height, width = animation.puppet.atlas.shape[:2]
    head = f"{stem}.png\nsize: {width}, {height}\nfilter: Linear, Linear\npma: false\n"
    return head + "".join(
        f"{name}\nbounds: {part.window.x}, {part.window.y}, {part.window.width}, {part.window.height}\n"
        for name, part in zip(_regions(parts), parts, strict=True)
    )


def _bones(parts: Sequence[MeshPart], skeleton: Skeleton, height: int) -> list[dict[str, Any]]:
    """List the bones as they rest, parents first."""
    names = _bone_names(parts)
    bones: list[dict[str, Any]] = [{"name": "root"}, {"name": WINDOW, "parent": "root", "y": height}]
    for bone in skeleton.bones:
        parent = WINDOW if bone.parent == ROOT else names[bone.parent]
        bones.append({"name": names[bone.layer], "parent": parent, **_xy(skeleton.from_parent(bone) * UP)})
    return bones


def _bone_names(parts: Sequence[MeshPart]) -> list[str]:
    return unique([part.name for part in parts], ["root", WINDOW])


def _tree(animation: Animation, parts: Sequence[MeshPart], skeleton: Skeleton, progress: Progress) -> dict[str, Any]:
    width, height = animation.size
    names, regions = _bone_names(parts), _regions(parts)
    meshes = {
        part.name: {part.name: _mesh(part, regions[layer], skeleton.of(layer).rest)} for layer, part in enumerate(parts)
    }
    return {
        "skeleton": {
            "hash": "wildpuppet", "spine": VERSION, "x": 0, "y": 0, "width": width, "height": height,
            "images": "./", "fps": round(float(animation.timing.rate), 3),
        },
        "bones": _bones(parts, skeleton, height),
        "slots": [
            {"name": part.name, "bone": name, "attachment": part.name} for part, name in zip(parts, names, strict=True)
        ],
        "skins": [{"name": "default", "attachments": meshes}],
        "events": {"shot": {}},
        "animations": {animation.name: _motion(animation, parts, skeleton, progress)},
    }  # fmt: skip


def _mesh(part: MeshPart, region: str, rest: Float[np.ndarray, "2"]) -> dict[str, Any]:
    hull = loops(part.edges)[0]
    edges = np.stack([np.arange(len(hull)), np.roll(np.arange(len(hull)), -1)], 1) * 2
    return {
        "type": "mesh", "path": region, "uvs": np.round(part.uv, 7).ravel().tolist(), "triangles": part.triangles,
        "vertices": (part.vertices - rest) * UP, "hull": len(hull), "edges": edges, "width": part.window.width,
        "height": part.window.height,
    }  # fmt: skip


def _motion(animation: Animation, parts: Sequence[MeshPart], skeleton: Skeleton, progress: Progress) -> dict[str, Any]:
    whole = Segment(animation.name, 0, len(animation))
    posed = list(keys(shown_poses(animation), whole, animation.shot_starts))
    shown = list(keys(animation.is_visible.tolist(), whole))
    deformed = {}
    for number, part in enumerate(parts):
        told = _share(progress, number, len(parts))
        deformed[part.name] = {part.name: {"deform": _bent(animation, skeleton, part, posed, told)}}
    names = _bone_names(parts)
    moved = {names[bone.layer]: _moved(animation, skeleton, bone, posed) for bone in skeleton.bones}
    return {
        "slots": {part.name: {"attachment": [_shown(animation, part, key) for key in shown]} for part in parts},
        "bones": {WINDOW: _window(animation, whole), **moved},
        "attachments": {"default": deformed},
        "drawOrder": [
            _order(animation, parts, key) for key in keys([order.tobytes() for order in animation.order], whole)
        ],
        "events": [
            {"time": _time(animation, t), "name": "shot", "int": number}
            for number, t in enumerate(animation.shot_starts, 1)
        ],
    }


def _time(animation: Animation, t: int) -> float:
    return round(float(animation.timing.seconds(t)), 6)


def _step(animation: Animation, key: Key) -> dict[str, Any]:
    """Say when a key is; one that does not glide is held until the next."""
    time = {"time": _time(animation, key.at)}
    return time if key.is_gliding else {**time, "curve": "stepped"}


def _xy(place: Float[np.ndarray, "2"]) -> dict[str, float]:
    return {"x": round(float(place[0]), 4), "y": round(float(place[1]), 4)}


def _shown(animation: Animation, part: MeshPart, key: Key) -> dict[str, Any]:
    return {"time": _time(animation, key.at), "name": part.name if animation.is_visible[key.at] else None}


def _moved(animation: Animation, skeleton: Skeleton, bone: Bone, posed: Sequence[Key]) -> dict[str, Any]:
    """Key a bone: what it does beyond how it rests."""
    degrees, scale = skeleton.degrees[bone.layer], skeleton.scale[bone.layer]
    shift = skeleton.shift[bone.layer] - skeleton.from_parent(bone)
    rows = [(_step(animation, key), key.at) for key in posed]
    return {
        "translate": [step | _xy(shift[t] * UP) for step, t in rows],
        "rotate": [step | {"value": -round(float(degrees[t]), 6)} for step, t in rows],
        "scale": [step | {"x": float(scale[t]), "y": float(scale[t])} for step, t in rows],
    }


def _bent(
    animation: Animation, skeleton: Skeleton, part: MeshPart, posed: Sequence[Key], progress: Progress
) -> Iterator[dict[str, Any]]:
    for key in posed:
        yield _step(animation, key) | {"vertices": bent(skeleton, animation, part, key.at) * UP}
        progress(key.at + key.duration, len(animation))


def _share(progress: Progress, number: int, count: int) -> Progress:
    """Let one of several like steps report its share of the whole."""
    return lambda done, total: progress((number * total + done) // count, total)


def _order(animation: Animation, parts: Sequence[MeshPart], key: Key) -> dict[str, Any]:
    """Write where each moved slot went, in slots forward from where it is at rest."""
    rank = np.argsort(animation.order[key.at]).tolist()
    offsets = [{"slot": parts[slot].name, "offset": place - slot} for slot, place in enumerate(rank) if slot != place]
    return {"time": _time(animation, key.at), **({"offsets": offsets} if offsets else {})}


def _window(animation: Animation, whole: Segment) -> dict[str, Any]:
    """Move the window's bone by turn, scale, shear and shift, which together are any affine map."""
    maps = animation.video_from_crop
    every = list(keys([each.tobytes() for each in maps], whole, animation.shot_starts))
    up = maps[:, :, :2] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    turn = np.degrees(np.unwrap(np.arctan2(up[:, 1, 0], up[:, 0, 0])))
    other = np.degrees(np.unwrap(np.arctan2(up[:, 1, 1], up[:, 0, 1]))) - 90.0
    scale = np.linalg.norm(up, axis=1)
    rows = [(_step(animation, key), key.at) for key in every]
    return {
        "translate": [step | _xy(maps[t, :, 2] * UP) for step, t in rows],
        "rotate": [step | {"value": round(float(turn[t]), 6)} for step, t in rows],
        "scale": [step | {"x": round(float(scale[t, 0]), 7), "y": round(float(scale[t, 1]), 7)} for step, t in rows],
        "shear": [step | {"y": round(float(other[t] - turn[t]), 6)} for step, t in rows],
    }
