"""glTF 2.0 in one file (GLB): a mesh per part, one morph target per distinct drawing, stepped keys, unlit.

For browsers (three.js), game engines and Blender. A drawing is shown by setting its target's weight to 1 and all
others to 0, so weights never leave [0, 1], which Blender clamps to, and positions are exact. Keys are steps at the
clip's own times: a drawing stays until the next one comes, as on film, and a held drawing is one target and one key.

Where the camera goes on over a held drawing, the node "Window" moves, not the mesh (``export/holds.py``). Layers stand
behind one another by their nodes' depth. A lost character, and drawings beyond ``MOST_TARGETS``, are hidden by scale
0: the graphics interface of browsers takes about 200 targets of a mesh, so long clips are spread over several meshes.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int
from PIL import Image

from wildpuppet.export.animation import Animation
from wildpuppet.export.glb_file import ARRAY_BUFFER, ELEMENT_BUFFER, Binary
from wildpuppet.export.glb_play import Player
from wildpuppet.export.holds import holds_of
from wildpuppet.export.manifest import Manifest, PositionError, position_error
from wildpuppet.export.options import Options
from wildpuppet.export.pieces import GAP, Piece, joint_names, joint_places, pieces_of
from wildpuppet.machine import Progress

MOST_TARGETS = 200
FILE = "puppet.glb"
LINEAR, CLAMP = 9729, 33071
CAMERA_PIXELS = 1000.0
"""Distance of the orthographic camera from the rearmost layer."""
Tree = dict[str, Any]


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write FOLDER/puppet.glb."""
    Scene(animation, options.units_per_pixel).write(folder / FILE, progress)
    words = ["frame numbers: glTF counts seconds, the first frame is at 0", "confidence of vertices"]
    if animation.timing.rate not in (24, 25, 30, 60):
        words.append(f"the frame rate: set {float(animation.timing.rate):g} frames per second before you import")
    return Manifest(
        "top left corner of the picture",
        "x right, y up, z towards the eye: layers by depth",
        0,
        options.units_per_pixel,
        tuple(words),
        read_back(animation, folder / FILE, options.units_per_pixel),
    )


class Scene:
    """A glTF tree that is being filled."""

    def __init__(self, animation: Animation, units: float) -> None:
        self.animation, self.units = animation, units
        self.pieces = pieces_of(animation.puppet)
        self.holds = holds_of(animation)
        count = len(self.holds.first)
        self.chunks = [range(start, min(start + MOST_TARGETS, count)) for start in range(0, count, MOST_TARGETS)]
        self.nodes: list[Tree] = []
        self.meshes: list[Tree] = []
        self.samplers: list[Tree] = []
        self.channels: list[Tree] = []
        self.times: dict[bytes, int] = {}

    def write(self, path: Path, progress: Progress) -> None:
        """Write everything."""
        self.binary = Binary(path.with_suffix(".part"))
        image = self._image()
        chunks = [self._chunk(number, progress) for number in range(len(self.chunks))]
        window = self._window(chunks)
        joints, camera = self._joints(), self._camera()
        root = self._node(self.animation.name, children=[window, *joints, camera])
        tree = {
            "asset": {"version": "2.0", "generator": "wildpuppet", "extras": self._extras()},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [root]}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "cameras": [self._lens()],
            "materials": [MATERIAL],
            "textures": [{"sampler": 0, "source": 0}],
            "samplers": [{"magFilter": LINEAR, "minFilter": LINEAR, "wrapS": CLAMP, "wrapT": CLAMP}],
            "images": [{"bufferView": image, "mimeType": "image/png", "name": "atlas"}],
            "animations": [{"name": "clip", "samplers": self.samplers, "channels": self.channels}],
        }
        if not self.channels:
            del tree["animations"]
        self.binary.write(path, tree)
        progress(len(self.animation), len(self.animation))

    def _window(self, chunks: list[int]) -> int:
        """Write the node that moves a held drawing as a whole."""
        window, moved = self._node("Window", children=chunks), self.holds.moved
        zoom, radians = _turn(moved)
        flat, same = np.zeros(len(moved)), np.ones(len(moved))
        shift = np.column_stack([moved[:, 0, 2] * self.units, -moved[:, 1, 2] * self.units, flat])
        self._move(window, "translation", shift.astype(np.float32))
        turn = np.column_stack([flat, flat, -np.sin(radians / 2), np.cos(radians / 2)])  # y points up here
        self._move(window, "rotation", turn.astype(np.float32))
        self._move(window, "scale", np.column_stack([zoom, zoom, same]).astype(np.float32))
        return window

    def _image(self) -> int:
        png = BytesIO()
        Image.fromarray(self.animation.puppet.atlas).save(png, format="PNG")
        return self.binary.add_bytes(png.getvalue())

    def _node(self, name: str, **more: Any) -> int:
        self.nodes.append({"name": name, **{key: value for key, value in more.items() if value != []}})
        return len(self.nodes) - 1

    def _chunk(self, number: int, progress: Progress) -> int:
        """Write the meshes of one run of drawings; give the node that shows and hides them."""
        chunk, parts = self.chunks[number], []
        weights = self._weights(chunk) if len(chunk) > 1 else None
        suffix = f" {number + 1}" if number else ""
        for place, piece in enumerate(self.pieces):
            node = self._node(piece.name + suffix, mesh=self._mesh(piece, chunk))
            if weights is not None:
                self._channel(node, "weights", weights)
            self._move(node, "translation", self._depths(piece))
            parts.append(node)
            done = (number + (place + 1) / len(self.pieces)) / len(self.chunks)
            progress(int(done * (len(self.animation) - 1)), len(self.animation))
        group = self._node(f"Drawings{suffix}", children=parts)
        is_shown = self.animation.is_visible & (self.holds.drawing >= chunk.start) & (self.holds.drawing < chunk.stop)
        self._move(group, "scale", np.repeat(is_shown.astype(np.float32)[:, None], 3, 1))
        return group

    def _mesh(self, piece: Piece, chunk: range) -> int:
        """Write one part's first drawing and what each other one differs by."""
        base = self._placed(piece, chunk.start)
        view = self.binary.begin(ARRAY_BUFFER, base, is_shared=True)
        position = self.binary.add_to(view, base, with_bounds=True)
        targets = [
            {"POSITION": self.binary.add_to(view, self._placed(piece, drawing) - base, with_bounds=True)}
            for drawing in chunk[1:]
        ]
        faces = piece.faces.ravel().astype(np.uint16 if len(piece.vertices) < 65535 else np.uint32)
        primitive = {
            "attributes": {
                "POSITION": position,
                "TEXCOORD_0": self.binary.add(piece.uv.astype(np.float32), ARRAY_BUFFER),
            },
            "indices": self.binary.add(faces, ELEMENT_BUFFER),
            "material": 0,
        }
        mesh: Tree = {"name": piece.name, "primitives": [primitive]}
        if targets:
            primitive["targets"] = targets
            frames = [int(self.animation.frames[self.holds.first[drawing]]) for drawing in chunk[1:]]
            mesh |= {"weights": [0.0] * len(targets), "extras": {"targetNames": [f"frame {n}" for n in frames]}}
        self.meshes.append(mesh)
        return len(self.meshes) - 1

    def _placed(self, piece: Piece, drawing: int) -> Float32[np.ndarray, "n 3"]:
        """Give a part's vertices in a drawing, flat."""
        flat = self.animation.vertices(int(self.holds.first[drawing]))[piece.vertices] * (self.units, -self.units)
        return np.column_stack([flat, np.zeros(len(flat))]).astype(np.float32)

    def _weights(self, chunk: range) -> int:
        """Write which drawing is shown when; all parts share it."""
        shown = self.holds.drawing - chunk.start
        shown = np.where((shown < 0) | (shown >= len(chunk)), 0, shown)
        keys = _changes(shown[:, None])
        weights = np.zeros((len(keys) + 1, len(chunk) - 1), np.float32)
        chosen = np.append(shown[keys], shown[-1])
        rows = np.flatnonzero(chosen)
        weights[rows, chosen[rows] - 1] = 1.0
        return self._sampler(keys, weights.ravel())

    def _depths(self, piece: Piece) -> Float32[np.ndarray, "T 3"]:
        """Place a part in depth, frame by frame."""
        ranks = (self.animation.order == piece.layer).argmax(1)
        return np.column_stack([np.zeros((len(ranks), 2)), ranks * GAP * self.units]).astype(np.float32)

    def _move(self, node: int, path: str, values: Float32[np.ndarray, "T n"]) -> None:
        """Set a node's translation, rotation or scale, and its keys where it moves."""
        keys = _changes(values)
        if len(keys) > 1:
            self._channel(node, path, self._sampler(keys, np.concatenate([values[keys], values[-1:]])))
        self.nodes[node][path] = [float(value) for value in values[0]]

    def _sampler(self, keys: Int[np.ndarray, "n"], values: Float32[np.ndarray, "..."]) -> int:
        """Write stepped keys at frames ``keys``; the last value is repeated at the end of the last frame."""
        timing = self.animation.timing
        exact = [*(timing.seconds(int(t)) for t in keys), timing.end_seconds()]
        times = np.array([_not_after(float(seconds)) for seconds in exact], np.float32)
        known = times.tobytes()
        if known not in self.times:
            self.times[known] = self.binary.add(times, with_bounds=True)
        sampler = {"input": self.times[known], "output": self.binary.add(values), "interpolation": "STEP"}
        self.samplers.append(sampler)
        return len(self.samplers) - 1

    def _channel(self, node: int, path: str, sampler: int) -> None:
        self.channels.append({"sampler": sampler, "target": {"node": node, "path": path}})

    def _joints(self) -> list[int]:
        """Write a node per joint that moves with it."""
        names = joint_names(self.animation.puppet)
        if not names:
            return []
        flat = np.stack([joint_places(self.animation.puppet, frame.vertices) for frame in self.animation])
        moves = np.concatenate([flat * (self.units, -self.units), np.zeros((*flat.shape[:2], 1))], -1)
        nodes = [self._node(name) for name in names]
        for joint, node in enumerate(nodes):
            self._move(node, "translation", moves[:, joint].astype(np.float32))
        return nodes

    def _camera(self) -> int:
        width, height = self.animation.size
        place = [width / 2 * self.units, -height / 2 * self.units, CAMERA_PIXELS * self.units]
        return self._node("Camera", camera=0, translation=place)

    def _lens(self) -> Tree:
        width, height = self.animation.size
        far = 2 * CAMERA_PIXELS * self.units
        sides = {"xmag": width / 2 * self.units, "ymag": height / 2 * self.units}
        return {"type": "orthographic", "orthographic": {**sides, "znear": far / 1e3, "zfar": far}}

    def _extras(self) -> Tree:
        timing, (width, height) = self.animation.timing, self.animation.size
        size = {"video_width": width, "video_height": height, "pixels_per_unit": 1 / self.units}
        return {"rate": str(timing.rate), "first_frame": int(self.animation.frames[0]), **size}


MATERIAL: Tree = {
    "name": "puppet",
    "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0},
    "alphaMode": "BLEND",
    "doubleSided": True,
    "extensions": {"KHR_materials_unlit": {}},
}


def _turn(similarity: Float[np.ndarray, "T 2 3"]) -> tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T"]]:
    """Give the zoom and the turn (radians, x towards y) of similarities."""
    cos, sin = similarity[:, 0, 0], similarity[:, 1, 0]
    return np.hypot(cos, sin), np.arctan2(sin, cos)


def _changes(values: np.ndarray) -> Int[np.ndarray, "n"]:
    """Find the frames whose value differs from the frame before; 0 is one."""
    changed = (np.diff(values, axis=0) != 0).any(1)
    return np.append(0, np.flatnonzero(changed) + 1)


def _not_after(seconds: float) -> np.float32:
    """Round to float32, never up: a key a hair late would show the frame before at its own frame's time."""
    rounded = np.float32(seconds)
    return rounded if float(rounded) <= seconds else np.nextafter(rounded, np.float32(-1))


def read_back(animation: Animation, path: Path, units: float) -> PositionError:
    """Open the file anew, play it, and compare every vertex of every frame with ours."""
    played = Player(path)
    pieces = pieces_of(animation.puppet)

    def distances() -> Iterator[Float32[np.ndarray, "n"]]:
        for frame in animation:
            if not frame.is_visible:
                continue
            found = played.frame(float(frame.seconds))
            for piece in pieces:
                flat = found[piece.name][:, :2] / (units, -units)
                yield np.linalg.norm(flat - frame.vertices[piece.vertices], axis=1).astype(np.float32)

    return position_error(distances(), "a reader of our own")
