"""Nuke: NAME.nk, atlas.png and parts/PART.png. Open it with File > Open: paths are counted from the script's folder.

- ``Hinges``, a Tracker4 with a track per hinge, switched off where the character is lost.
- ``PART_pin``, a CornerPin2D per part: its picture at rest, turned, scaled, sheared and moved as the part does on the
  whole; they are merged in the order of each frame. Bending is left out; the manifest says how far that is off.
- ``Drawn``, an STMap that draws the puppet exactly from atlas.png and the ``exr`` export, if that lies beside this one.

y is up, zero at the picture's lower left corner. The text is Tcl; curves have a key in every frame.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest, position_error
from wildpuppet.export.naming import file_names, identifiers
from wildpuppet.export.options import Options
from wildpuppet.export.pieces import joint_names, joint_places
from wildpuppet.export.sprites import Sprite, sprites_at_rest
from wildpuppet.export.stacking import sheets
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import Progress

VERSION = "14.0 v1"
HERE = r"\[file dirname \[value root.name]]"
TRACK_COLUMNS = (
    "5 1 20 enable e 1", "3 1 75 name name 1", "2 1 58 track_x track_x 1", "2 1 58 track_y track_y 1",
    "2 1 63 offset_x offset_x 1", "2 1 63 offset_y offset_y 1", "4 1 27 T T 1", "4 1 27 R R 1", "4 1 27 S S 1",
    "2 0 45 error error 1", "1 1 0 error_min error_min 1", "1 1 0 error_max error_max 1",
    *(f"1 1 0 {area}_{side} {area}_{side} 1" for area in ("pattern", "search") for side in "xyrt"),
    "2 1 0 key_track key_track 1",
    *(f"2 1 0 key_{area}_{side} key_{area}_{side} 1" for area in ("search", "track") for side in "xyrt"),
    "2 1 0 key_centre_offset_x key_centre_offset_x 1", "2 1 0 key_centre_offset_y key_centre_offset_y 1",
)  # fmt: skip
"""Columns of Tracker4's table, as Nuke itself writes them."""


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write the script and the pictures that it reads."""
    first, sprites = options.first_of(int(animation.frames[0])), sprites_at_rest(animation.puppet)
    stems = file_names(animation.puppet.names)
    (folder / "parts").mkdir()
    Image.fromarray(animation.puppet.atlas).save(folder / "atlas.png")
    for stem, sprite in zip(stems, sprites, strict=True):
        Image.fromarray(np.ascontiguousarray(sprite.rgba)).save(folder / "parts" / f"{stem}.png")
    maps = part_maps(animation)
    progress(1, 2)
    path = folder / f"{file_names([animation.name])[0]}.nk"
    with path.open("w", encoding="ascii") as file:
        file.writelines(_root(animation, first))
        file.writelines(_tracker(animation, first))
        file.writelines(_pins(animation, maps, sprites, stems, first))
        file.writelines(_drawn(animation, first))
    progress(2, 2)
    axes = "x right, y up, pixels"
    left_out = tuple(_left_out(animation))
    error = position_error(_off(animation, maps), "the corner pins' own maps")
    return Manifest("bottom left corner of the picture", axes, first, 1.0, left_out, error)


def _left_out(animation: Animation) -> Iterator[str]:
    yield "the meshes' bending, in the corner pins; the STMap has it, and needs the exr export"
    if animation.timing.is_variable:
        yield "the clip's uneven times: Nuke counts frames"


def part_maps(animation: Animation) -> Float[np.ndarray, "T L 2 3"]:
    """Fit each part's whole motion: the affine map from the canvas to the video nearest to its vertices."""
    puppet = animation.puppet
    maps = np.zeros((len(animation), puppet.num_layers, 2, 3))
    for layer in range(puppet.num_layers):
        mine = np.flatnonzero(puppet.layer_of_vertex == layer)
        rest = np.column_stack([puppet.vertices[mine].astype(np.float64), np.ones(len(mine))])
        solve = np.linalg.pinv(rest)
        for t in range(len(animation)):
            maps[t, layer] = (solve @ animation.vertices(t)[mine]).T
    return maps


def _off(animation: Animation, maps: Float[np.ndarray, "T L 2 3"]) -> Iterator[Float[np.ndarray, "V"]]:
    """Distances of the parts' vertices from where the pins take them."""
    puppet = animation.puppet
    for t in np.flatnonzero(animation.is_visible):
        own = maps[t, puppet.layer_of_vertex]
        pinned = np.einsum("vij,vj->vi", own[:, :, :2], puppet.vertices.astype(np.float64)) + own[:, :, 2]
        yield np.linalg.norm(pinned - animation.vertices(int(t)), axis=1)


def curve(first: int, values: Sequence[float], is_stepped: bool = False) -> str:
    """Write a curve with a key in every frame; a stepped one only where it changes."""
    keys = [(first + t, value) for t, value in enumerate(values)]
    if is_stepped:
        keys = [key for t, key in enumerate(keys) if t == 0 or key[1] != keys[t - 1][1]]
    return "{curve " + ("K " if is_stepped else "") + " ".join(f"x{at} {value:.9g}" for at, value in keys) + "}"


def _root(animation: Animation, first: int) -> Iterator[str]:
    width, height = animation.size
    last = first + len(animation) - 1
    yield f"#! wildpuppet\nversion {VERSION}\n"
    yield f"Root {{\n inputs 0\n frame {first}\n first_frame {first}\n last_frame {last}\n"
    yield f" fps {float(animation.timing.rate):.9g}\n"
    yield f' format "{width} {height} 0 0 {width} {height} 1 wildpuppet_{width}x{height}"\n}}\n'


def _seen(animation: Animation) -> list[float]:
    return [1.0 if is_visible else 0.0 for is_visible in animation.is_visible]


def _up(animation: Animation, places: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    return np.asarray(places * np.array([1.0, -1.0]) + np.array([0.0, animation.size[1]]))


def _tracker(animation: Animation, first: int) -> Iterator[str]:
    names = identifiers(joint_names(animation.puppet))
    if not names:
        return
    places = np.stack([joint_places(animation.puppet, frame.vertices) for frame in animation])
    seen = curve(first, _seen(animation), is_stepped=True)
    columns = "\n".join(f"{{ {column} }}" for column in TRACK_COLUMNS)
    yield f"Tracker4 {{\n inputs 0\n tracks {{ {{ 1 {len(TRACK_COLUMNS)} {len(names)} }}\n{{ {columns} }}\n{{\n"
    for j, name in enumerate(names):
        x, y = (curve(first, line.tolist()) for line in _up(animation, places[:, j]).T)
        yield f' {{ {seen} "{name}" {x} {y} {{0}} {{0}} 1 0 0 {{0}} 1 0 -32 -32 32 32 -22 -22 22 22'
        yield " {}" * 11 + " }\n"
    yield "} }\n name Hinges\n}\n"


def _pins(
    animation: Animation,
    maps: Float[np.ndarray, "T L 2 3"],
    sprites: Sequence[Sprite],
    stems: Sequence[str],
    first: int,
) -> Iterator[str]:
    """Pin every part's picture, and merge the pins back to front: one merge for each place that a part has."""
    names = identifiers(animation.puppet.names)
    width, height = animation.size
    for layer, sprite in enumerate(sprites):
        yield f'Read {{\n inputs 0\n file_type png\n file "{HERE}/parts/{stems[layer]}.png"\n'
        yield f" premultiplied false\n name {names[layer]}_picture\n}}\n"
        yield f"Premult {{\n name {names[layer]}_premult\n}}\n"
        yield from _pin(animation, maps[:, layer], sprite, names[layer], first)
        yield f"set pin{layer} [stack 0]\n"
    yield f'Constant {{\n inputs 0\n format "{width} {height} 0 0 {width} {height} 1"\n name Empty\n}}\n'
    yield "set under [stack 0]\n"
    for number, sheet in enumerate(sheets(animation.order), 1):
        hidden = curve(first, (~sheet.shown(animation.is_visible)).astype(float).tolist(), is_stepped=True)
        yield f"push $pin{sheet.layer}\npush $under\nMerge2 {{\n inputs 2\n operation over\n disable {{{hidden}}}\n"
        yield f" name {names[sheet.layer]}_over_{number}\n}}\nset under [stack 0]\n"


def _pin(
    animation: Animation, moved: Float[np.ndarray, "T 2 3"], sprite: Sprite, name: str, first: int
) -> Iterator[str]:
    """Carry a picture's corners along: lower left, lower right, upper right, upper left."""
    h, w = sprite.rgba.shape[:2]
    corners = np.array([[0, h], [w, h], [w, 0], [0, 0]], np.float64) + np.array([sprite.left, sprite.top])
    pinned = _up(animation, apply(moved, corners[None]))
    yield "CornerPin2D {\n"
    for k in range(4):
        x, y = (curve(first, line.tolist()) for line in pinned[:, k].T)
        yield f" to{k + 1} {{{x} {y}}}\n"
    for k, (x, y) in enumerate(((0, 0), (w, 0), (w, h), (0, h)), 1):
        yield f" from{k} {{{x} {y}}}\n"
    yield f" name {name}_pin\n}}\n"


def _drawn(animation: Animation, first: int) -> Iterator[str]:
    """Look the atlas up where the ST map says; its alpha is the puppet's coverage."""
    last = first + len(animation) - 1
    yield f'Read {{\n inputs 0\n file_type exr\n file "{HERE}/../exr/st/st.%05d.exr"\n first {first}\n last {last}\n'
    yield " raw true\n on_error black\n name Map\n}\nset map [stack 0]\n"
    yield f'Read {{\n inputs 0\n file_type png\n file "{HERE}/atlas.png"\n name Atlas\n}}\n'
    yield "STMap {\n inputs 2\n channels rgb\n uv rgb\n name Lookup\n}\nset looked_up [stack 0]\n"
    yield "push $map\npush $looked_up\n"
    yield "Copy {\n inputs 2\n from0 rgba.alpha\n to0 rgba.alpha\n name Coverage\n}\nPremult {\n name Drawn\n}\n"
