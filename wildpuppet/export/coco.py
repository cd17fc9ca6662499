"""COCO annotations: for every frame the visible mask of each part, and the whole character with its hinges.

NAME.json. Categories: 1 is the whole character, with one keypoint per hinge; 2 and up are the parts, in the puppet's
order. Masks are run-length encoded (COCO's compressed strings), areas and boxes are theirs. Keypoints count from the
first pixel's centre, as COCO does: (0, 0) is the middle of the upper left pixel; 2 visible, 1 hidden, and 0 (with
x = y = 0) outside the picture. ``score`` is how sure the mesh is there, 0..1, over the part's vertices. A frame's
``file_name`` is its number in six digits: the pictures stay in the clip.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.json_stream import write_json
from wildpuppet.export.keys import Joint, joints
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import Progress

CHARACTER, FIRST_PART = 1, 2
VISIBLE, HIDDEN = 2, 1


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.json, frame by frame."""
    first = options.first_of(int(animation.frames[0]))
    tree = {
        "info": {"description": f"{animation.name}: parts and hinges of a puppet", "version": "1.0"},
        "licenses": [],
        "categories": _categories(animation),
        "images": (_image(animation, frame, first) for frame in animation),
        "annotations": _annotations(animation, progress),
    }
    with (folder / f"{file_names([animation.name])[0]}.json").open("w", encoding="utf-8") as file:
        write_json(file, tree)
    left_out = ("pictures: take the frames of the clip", "meshes, textures, parts that are wholly hidden")
    return Manifest("centre of the top left pixel", "x right, y down, pixels", first, 1.0, left_out)


def _categories(animation: Animation) -> list[dict[str, Any]]:
    puppet = animation.puppet
    whole = {
        "id": CHARACTER, "name": "character", "supercategory": "puppet",
        "keypoints": [joint.name for joint in joints(animation)], "skeleton": _skeleton(puppet.joint_layers),
    }  # fmt: skip
    parts = [
        {"id": FIRST_PART + layer, "name": name, "supercategory": "part"} for layer, name in enumerate(puppet.names)
    ]
    return [whole, *parts]


def _skeleton(joint_layers: Int[np.ndarray, "J 2"]) -> list[list[int]]:
    """Join hinges that share a part; COCO counts keypoints from 1."""
    layers = [set(pair) for pair in joint_layers.tolist()]
    return [[a + 1, b + 1] for b in range(len(layers)) for a in range(b) if layers[a] & layers[b]]


def _image(animation: Animation, frame: Frame, first: int) -> dict[str, Any]:
    width, height = animation.size
    name = f"{first + frame.t:06d}.png"
    return {"id": frame.t + 1, "width": width, "height": height, "file_name": name, "frame": frame.number}


def _annotations(animation: Animation, progress: Progress) -> Iterator[dict[str, Any]]:
    from wildpuppet.export.seen import Seen

    seen, hinges, number = Seen(animation), joints(animation), 0
    for frame in animation:
        layer_at = np.asarray(seen.at(frame)[0])
        for layer in (None, *np.unique(layer_at[layer_at >= 0]).tolist()):
            mask = layer_at >= 0 if layer is None else layer_at == layer
            if mask.any():
                number += 1
                category = CHARACTER if layer is None else FIRST_PART + layer
                said: dict[str, Any] = {"id": number, "image_id": frame.t + 1, "category_id": category, "iscrowd": 0}
                said["score"] = _score(animation, frame, layer)
                yield said | _outline(mask) | (_keypoints(animation, frame, hinges) if layer is None else {})
        progress(frame.t + 1, len(animation))


def _score(animation: Animation, frame: Frame, layer: int | None) -> float:
    """Average the confidence of a part's vertices, or of all."""
    mine = slice(None) if layer is None else animation.puppet.layer_of_vertex == layer
    return round(float(animation.confidence[frame.t, mine].mean()), 4)


def _keypoints(animation: Animation, frame: Frame, hinges: list[Joint]) -> dict[str, Any]:
    """Say where the hinges are; one is hidden where a part in front of both of its own covers it."""
    from wildpuppet.correspond import cover

    puppet, size = animation.puppet, np.array(animation.size)
    if not hinges:
        return {"keypoints": [], "num_keypoints": 0}
    window = animation.video_from_crop[frame.t]
    places = apply(window, np.stack([hinge.crop[frame.t] for hinge in hinges]))
    rank = cover.rank_of(frame.order[None])
    pair = puppet.joint_layers.astype(np.int64)
    nearer = np.where(rank[0][pair[:, 0]] > rank[0][pair[:, 1]], pair[:, 0], pair[:, 1])
    hidden: Bool[np.ndarray, "1 J"] = cover.covered(
        frame.vertices[None], puppet.triangles, puppet.layer_of_triangle, rank, puppet.uv, puppet.atlas[..., 3],
        places[None], nearer,
    )  # fmt: skip
    inside = np.asarray(((places >= 0.0) & (places < size)).all(1))
    rows = [
        [round(float(x) - 0.5, 3), round(float(y) - 0.5, 3), HIDDEN if is_hidden else VISIBLE] if is_inside else [0] * 3
        for (x, y), is_hidden, is_inside in zip(places, hidden[0], inside, strict=True)
    ]
    return {"keypoints": [number for row in rows for number in row], "num_keypoints": int(inside.sum())}


def _outline(mask: Bool[np.ndarray, "H W"]) -> dict[str, Any]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    x, y = int(columns[0]), int(rows[0])
    box = [x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1]
    coded = {"size": list(mask.shape), "counts": compressed(run_lengths(mask))}
    return {"area": int(mask.sum()), "bbox": box, "segmentation": coded}


def run_lengths(mask: Bool[np.ndarray, "H W"]) -> list[int]:
    """Count runs down the columns, zeros first."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    return [int(length) for length in np.diff(np.concatenate([[0], changes, [mask.size]]))]


def compressed(counts: list[int]) -> str:
    """Write run lengths as COCO's string: differences to the run before last, in groups of five bits."""
    letters = []
    for place, count in enumerate(counts):
        value = count - (counts[place - 2] if place > 2 else 0)
        is_more = True
        while is_more:
            bits, value = value & 31, value >> 5
            is_more = value != (-1 if bits & 16 else 0)
            letters.append(chr(bits + (32 if is_more else 0) + 48))
    return "".join(letters)
