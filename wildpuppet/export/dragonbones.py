"""DragonBones 5.5: NAME_ske.json, NAME_tex.json, NAME_tex.png; y down, as in the video.

Bones: ``window``, which follows the character through the picture, and under it one per part, each hung on its hinge
(``export/bones.py``). One slot per part on its bone, with a mesh whose bending is in ``ffd`` keys, a draw-order
timeline, and a display timeline that hides the puppet where the character is lost. At rest the puppet stands as it was
drawn, in canvas pixels.

The runtimes index a timeline's numbers with 16 bits. An animation whose numbers would not fit is cut into parts that
play one after the other; so are shots.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from PIL import Image

from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation
from wildpuppet.export.bones import ROOT, Bone, Skeleton, bent, skeleton_of, written_error
from wildpuppet.export.json_stream import write_json
from wildpuppet.export.keys import Key, Segment, keys, segments, shown_poses, unique
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.export.rig import MeshPart, mesh_parts
from wildpuppet.machine import Progress

MOST_NUMBERS = 2**16 - 1
"""Numbers before the last timeline of an animation: the runtimes keep each timeline's place in 16 bits."""
MOST_CORNERS = 2**13 - 1
"""Corners of all meshes: four numbers each, placed by 15 bits."""
WINDOW = "window"


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write the three files. Raises InputError for a puppet with more corners than the format can number."""
    if len(animation.puppet.vertices) > MOST_CORNERS:
        raise InputError(f"DragonBones holds {MOST_CORNERS} mesh corners, found {len(animation.puppet.vertices)}")
    stem = file_names([animation.name])[0]
    rig = _Rig(animation, mesh_parts(animation.puppet), skeleton_of(animation))
    cut = segments(animation, _most_frames(rig.parts))
    Image.fromarray(animation.puppet.atlas).save(folder / f"{stem}_tex.png")
    with (folder / f"{stem}_tex.json").open("w", encoding="utf-8") as file:
        write_json(file, _textures(animation, rig.parts, stem))
    with (folder / f"{stem}_ske.json").open("w", encoding="utf-8") as file:
        write_json(file, rig.tree(stem, cut, progress))
    said, axes = tuple(_left_out(animation, cut)), "x right, y down, pixels"
    error = written_error(rig.skeleton, animation, rig.parts)
    return Manifest("top left corner of the picture", axes, 0, 1.0, said, error)


def _left_out(animation: Animation, cut: Sequence[Segment]) -> Iterator[str]:
    rate = animation.timing.rate
    if rate.denominator != 1:
        yield f"DragonBones counts whole frames per second: {rate} is written as {round(rate)}"
    if animation.timing.is_variable:
        yield f"the clip's uneven times: every frame lasts 1/{round(rate)} s"
    if len(cut) > 1:
        spans = ", ".join(f"{each.name}: frames {_number(animation, each)}" for each in cut)
        yield f"one animation for all frames; in pieces that play one after the other ({spans})"


def _number(animation: Animation, segment: Segment) -> str:
    return f"{animation.frames[segment.start]} to {animation.frames[segment.end - 1]}"


def _most_frames(parts: Sequence[MeshPart]) -> int:
    """Frames of an animation that the 16 bits hold, at the worst a key each.

    Two tables are indexed: one of numbers (six for the window and for every bone, the meshes' offsets; the last mesh,
    which is the largest, may reach beyond) and one of keys (two entries each; draw order takes one per slot).
    """
    corners = [len(part.vertices) for part in parts]
    numbers = 6 * (1 + len(parts)) + 2 * (sum(corners) - max(corners))
    entries = 2 * (3 + 5 * len(parts)) + 2 + len(parts)
    return max(2, MOST_NUMBERS // max(numbers, entries))


def _textures(animation: Animation, parts: Sequence[MeshPart], stem: str) -> dict[str, Any]:
    height, width = animation.puppet.atlas.shape[:2]
    regions = [
        {"name": part.name, "x": part.window.x, "y": part.window.y, "width": part.window.width,
         "height": part.window.height}
        for part in parts
    ]  # fmt: skip
    return {"name": stem, "imagePath": f"{stem}_tex.png", "width": width, "height": height, "SubTexture": regions}


def _mesh(part: MeshPart, rest: Float[np.ndarray, "2"]) -> dict[str, Any]:
    uv = np.round(part.uv, 7).ravel().tolist()
    return {
        "type": "mesh", "name": part.name, "width": part.window.width, "height": part.window.height,
        "vertices": part.vertices - rest, "uvs": uv, "triangles": part.triangles, "edges": part.edges, "userEdges": [],
    }  # fmt: skip


class _Rig:
    """Writes one armature."""

    def __init__(self, animation: Animation, parts: Sequence[MeshPart], skeleton: Skeleton) -> None:
        self._animation, self.parts, self.skeleton = animation, parts, skeleton
        self._names = unique([part.name for part in parts], ["root", WINDOW])
        self._poses = shown_poses(animation)

    def tree(self, stem: str, cut: Sequence[Segment], progress: Progress) -> dict[str, Any]:
        """Give the whole file; the animations are made as they are written."""
        rate, (width, height) = round(self._animation.timing.rate), self._animation.size
        rests = [self.skeleton.of(layer).rest for layer in range(len(self.parts))]
        shapes = [
            {"name": part.name, "display": [_mesh(part, rest)]} for part, rest in zip(self.parts, rests, strict=True)
        ]
        armature = {
            "type": "Armature", "frameRate": rate, "name": stem,
            "aabb": {"x": 0, "y": 0, "width": width, "height": height},
            "bone": [{"name": "root"}, {"name": WINDOW, "parent": "root"}, *self._bones()],
            "slot": [{"name": part.name, "parent": name} for part, name in zip(self.parts, self._names, strict=True)],
            "skin": [{"name": "default", "slot": shapes}],
            "animation": (self._motion(each, progress) for each in cut),
            "defaultActions": [{"gotoAndPlay": cut[0].name}],
        }  # fmt: skip
        return {"frameRate": rate, "name": stem, "version": "5.5", "compatibleVersion": "5.5", "armature": [armature]}

    def _bones(self) -> Iterator[dict[str, Any]]:
        for bone in self.skeleton.bones:
            parent = WINDOW if bone.parent == ROOT else self._names[bone.parent]
            place = _place(self.skeleton.from_parent(bone))
            yield {"name": self._names[bone.layer], "parent": parent, "transform": place}

    def _motion(self, segment: Segment, progress: Progress) -> dict[str, Any]:
        animation, visible = self._animation, self._animation.is_visible.tolist()
        posed = list(keys(self._poses, segment))
        shown = [{"duration": key.duration, "value": 0 if visible[key.at] else -1} for key in keys(visible, segment)]

        def bent_parts() -> Iterator[dict[str, Any]]:
            for done, part in enumerate(sorted(self.parts, key=lambda part: len(part.vertices)), 1):
                frames = self._bent(part, posed)
                yield {"name": part.name, "slot": part.name, "skin": "default", "frame": frames}
                progress(segment.start + (segment.end - segment.start) * done // len(self.parts), len(animation))

        return {
            "duration": segment.end - segment.start, "playTimes": 1, "name": segment.name,
            "zOrder": {"frame": _orders(animation, segment)},
            "bone": [_window(animation, segment), *(self._moved(bone, posed) for bone in self.skeleton.bones)],
            "slot": [{"name": part.name, "displayFrame": shown} for part in self.parts],
            "ffd": bent_parts(),
        }  # fmt: skip

    def _drawn_at(self, key: Key) -> int:
        """Find a frame index that has the key's pose: where the character is lost, the frame before it."""
        return self._poses.index(self._poses[key.at])

    def _moved(self, bone: Bone, posed: Sequence[Key]) -> dict[str, Any]:
        """Key a bone: what it does beyond how it rests."""
        degrees, scale, shift = (each[bone.layer] for each in (self.skeleton.degrees, self.skeleton.scale,
                                                                self.skeleton.shift))  # fmt: skip
        rest, rows = self.skeleton.from_parent(bone), [(_step(key), self._drawn_at(key)) for key in posed]
        return {
            "name": self._names[bone.layer],
            "translateFrame": [step | _place(shift[t] - rest) for step, t in rows],
            "rotateFrame": [step | {"rotate": round(float(degrees[t]), 6)} for step, t in rows],
            "scaleFrame": [step | {"x": float(scale[t]), "y": float(scale[t])} for step, t in rows],
        }

    def _bent(self, part: MeshPart, posed: Sequence[Key]) -> Iterator[dict[str, Any]]:
        for key in posed:
            yield _step(key) | {
                "offset": 0,
                "vertices": bent(self.skeleton, self._animation, part, self._drawn_at(key)),
            }


def _step(key: Key) -> dict[str, Any]:
    """Say how long a key lasts; without ``tweenEasing`` it is held until the next."""
    return {"duration": key.duration, "tweenEasing": 0} if key.is_gliding else {"duration": key.duration}


def _place(offset: Float[np.ndarray, "2"]) -> dict[str, float]:
    return {"x": round(float(offset[0]), 4), "y": round(float(offset[1]), 4)}


def _orders(animation: Animation, segment: Segment) -> list[dict[str, Any]]:
    """Write where each moved slot went, in slots forward from where it is at rest."""
    return [
        {"duration": key.duration, "zOrder": _moves(animation.order[key.at])}
        for key in keys([order.tobytes() for order in animation.order], segment)
    ]


def _moves(order: Int[np.ndarray, "L"]) -> list[int]:
    rank = np.argsort(order).tolist()
    return [number for slot, place in enumerate(rank) if slot != place for number in (slot, place - slot)]


def _window(animation: Animation, segment: Segment) -> dict[str, Any]:
    """Move the window's bone by turn, skew, scale and shift, which together are any affine map."""
    maps = [animation.video_from_crop[t] for t in range(len(animation))]
    every = list(keys([each.tobytes() for each in maps], segment))
    turns = np.degrees(np.unwrap([np.arctan2(each[1, 0], each[0, 0]) for each in maps]))
    leans = np.degrees(np.unwrap([np.arctan2(-each[0, 1], each[1, 1]) for each in maps]))
    scales = [np.linalg.norm(each[:, :2], axis=0) for each in maps]
    return {
        "name": WINDOW,
        "translateFrame": [_step(key) | _place(maps[key.at][:, 2]) for key in every],
        "rotateFrame": [
            _step(key) | {"rotate": round(turns[key.at], 6), "skew": round(leans[key.at] - turns[key.at], 6)}
            for key in every
        ],
        "scaleFrame": [
            _step(key) | {"x": round(float(scales[key.at][0]), 7), "y": round(float(scales[key.at][1]), 7)}
            for key in every
        ],
    }
