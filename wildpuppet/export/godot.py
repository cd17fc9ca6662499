"""Godot 4: NAME.tscn and NAME.png; put the folder anywhere in a project. y down, as in the video.

A Node2D with ``Window``, which follows the character through the picture, under it a Polygon2D per part and a Marker2D
per hinge, and an AnimationPlayer: tracks for the window's transform, every part's ``polygon``, ``z_index`` for the
order, ``visible`` where the character is lost, and the hinges' positions. One animation per shot. A drawing that is
held is a key with transition 0, which Godot holds until the next one.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from PIL import Image

from wildpuppet.export.animation import Animation
from wildpuppet.export.json_stream import DECIMALS, numbers
from wildpuppet.export.keys import Joint, Key, Segment, joints, keys, segments, shown_poses
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names, identifiers
from wildpuppet.export.options import Options
from wildpuppet.export.rig import MeshPart, hull_first, loops, mesh_parts, written_error
from wildpuppet.machine import Progress

CONTINUOUS, DISCRETE = 0, 1
WINDOW, PLAYER = "Window", "AnimationPlayer"


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write the scene and its texture."""
    stem = file_names([animation.name])[0]
    parts = [hull_first(part) for part in mesh_parts(animation.puppet)]
    Image.fromarray(animation.puppet.atlas).save(folder / f"{stem}.png")
    cut = segments(animation, len(animation))
    with (folder / f"{stem}.tscn").open("w", encoding="utf-8") as file:
        _Scene(animation, parts, file, progress).write(stem, cut)
    left_out = ["the clip as one animation: there is one per shot"] if len(cut) > 1 else []
    axes = "x right, y down, pixels"
    error = written_error(animation)
    return Manifest("top left corner of the picture", axes, 0, 1.0, tuple(left_out), error)


class _Scene:
    """Writes one scene, section by section."""

    def __init__(self, animation: Animation, parts: Sequence[MeshPart], file: TextIO, progress: Progress) -> None:
        self._animation, self._parts, self._file, self._progress = animation, parts, file, progress
        self._hinges = joints(animation)
        names = identifiers([*(part.name for part in parts), *(hinge.name for hinge in self._hinges)], (WINDOW, PLAYER))
        self._nodes = names[: len(parts)]
        self._markers = names[len(parts) :]
        self._poses = shown_poses(animation)

    def write(self, stem: str, cut: Sequence[Segment]) -> None:
        """Write everything."""
        names = identifiers([each.name for each in cut])
        self._file.write(f"[gd_scene load_steps={len(cut) + 3} format=3]\n\n")
        self._file.write(f'[ext_resource type="Texture2D" path="{stem}.png" id="1_atlas"]\n\n')
        for name, segment in zip(names, cut, strict=True):
            self._file.write(f'[sub_resource type="Animation" id="Animation_{name}"]\nresource_name = "{name}"\n')
            self._motion(segment)
        shared = ",\n".join(f'"{name}": SubResource("Animation_{name}")' for name in names)
        self._file.write(
            f'[sub_resource type="AnimationLibrary" id="AnimationLibrary_1"]\n_data = {{\n{shared}\n}}\n\n'
        )
        self._tree(stem, names[0])

    def _time(self, index: int) -> float:
        timing = self._animation.timing
        return float(timing.end_seconds() if index == len(self._animation) else timing.seconds(index))

    def _motion(self, segment: Segment) -> None:
        """Write one animation's tracks."""
        animation, start = self._animation, self._time(segment.start)
        self._file.write(f"length = {self._time(segment.end) - start:.6f}\n")
        self._file.write(f"step = {1.0 / float(animation.timing.rate):.6f}\n")
        for track, (path, update, moved) in enumerate(self._tracks(segment)):
            rows = list(moved)
            times = ", ".join(f"{self._time(key.at) - start:.6f}" for key, _ in rows)
            glides = ", ".join("1" if key.is_gliding else "0" for key, _ in rows)
            head = f"tracks/{track}/"
            self._file.write(f'{head}type = "value"\n{head}imported = false\n{head}enabled = true\n')
            self._file.write(f'{head}path = NodePath("{path}")\n{head}interp = 1\n{head}loop_wrap = false\n')
            self._file.write(f'{head}keys = {{\n"times": PackedFloat32Array({times}),\n')
            self._file.write(f'"transitions": PackedFloat32Array({glides}),\n"update": {update},\n"values": [')
            for place, (_, value) in enumerate(rows):
                self._file.write((", " if place else "") + value)
            self._file.write("]\n}\n")
            share = (track + 1) / (2 + 2 * len(self._parts) + len(self._hinges))
            self._progress(int(segment.start + share * (segment.end - segment.start)), len(animation))
        self._file.write("\n")

    def _tracks(self, segment: Segment) -> Iterator[tuple[str, int, Iterable[tuple[Key, str]]]]:
        """Give each track's path, update mode, and its keys with their values as text."""
        animation = self._animation
        windows = list(keys([each.tobytes() for each in animation.video_from_crop], segment))
        yield f"{WINDOW}:transform", CONTINUOUS, [(key, self._window(key.at)) for key in windows]
        shown = list(keys(animation.is_visible.tolist(), segment))
        yield f"{WINDOW}:visible", DISCRETE, [(key, str(bool(animation.is_visible[key.at])).lower()) for key in shown]
        orders = list(keys([order.tobytes() for order in animation.order], segment))
        posed = list(keys(self._poses, segment))
        for layer, (node, part) in enumerate(zip(self._nodes, self._parts, strict=True)):
            ranks = [(key, str(int(np.argsort(animation.order[key.at])[layer]))) for key in orders]
            yield f"{WINDOW}/{node}:z_index", DISCRETE, ranks
            yield f"{WINDOW}/{node}:polygon", CONTINUOUS, ((key, self._polygon(part, key)) for key in posed)
        for name, hinge in zip(self._markers, self._hinges, strict=True):
            yield f"{WINDOW}/{name}:position", CONTINUOUS, [(key, self._place(hinge, key)) for key in posed]

    def _drawn_at(self, key: Key) -> int:
        """Frame index that shows the key's pose: where the character is lost, the frame before it."""
        return self._poses.index(self._poses[key.at])

    def _polygon(self, part: MeshPart, key: Key) -> str:
        return _packed("PackedVector2Array", self._animation.vertices_crop[self._drawn_at(key)][part.corners])

    def _place(self, hinge: Joint, key: Key) -> str:
        return _packed("Vector2", hinge.crop[self._drawn_at(key)])

    def _window(self, t: int) -> str:
        """Write an affine map: its x axis, its y axis, its origin."""
        window = self._animation.video_from_crop[t]
        return "Transform2D(" + ", ".join(f"{number:.9g}" for number in window.T.ravel()) + ")"

    def _tree(self, stem: str, first: str) -> None:
        """Write the nodes as they are in the first frame."""
        animation, write = self._animation, self._file.write
        write(f'[node name="{identifiers([stem])[0]}" type="Node2D"]\n\n')
        write(f'[node name="{WINDOW}" type="Node2D" parent="."]\ntransform = {self._window(0)}\n\n')
        ranks = np.argsort(animation.order[0]).tolist()
        for node, part, rank in zip(self._nodes, self._parts, ranks, strict=True):
            texels = animation.puppet.uv[part.corners]
            triangles = ", ".join(_packed("PackedInt32Array", corners) for corners in part.triangles)
            hull = len(loops(part.edges)[0])
            write(f'[node name="{node}" type="Polygon2D" parent="{WINDOW}"]\nz_index = {rank}\n')
            write('texture = ExtResource("1_atlas")\n')
            write(f"polygon = {_packed('PackedVector2Array', animation.vertices_crop[0][part.corners])}\n")
            write(f"uv = {_packed('PackedVector2Array', texels)}\npolygons = [{triangles}]\n")
            write(f"internal_vertex_count = {len(part.corners) - hull}\n\n")
        for name, hinge in zip(self._markers, self._hinges, strict=True):
            write(f'[node name="{name}" type="Marker2D" parent="{WINDOW}"]\n')
            write(f"position = {_packed('Vector2', hinge.crop[0])}\n\n")
        write(f'[node name="{PLAYER}" type="AnimationPlayer" parent="."]\n')
        write(f'libraries = {{\n"": SubResource("AnimationLibrary_1")\n}}\nautoplay = "{first}"\n')


def _packed(kind: str, values: np.ndarray) -> str:
    """Write numbers as one of Godot's arrays, rounded like the rest of our text."""
    return f"{kind}({numbers(np.round(values, DECIMALS) if values.dtype.kind == 'f' else values)[1:-1]})"
