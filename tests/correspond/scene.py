"""A small puppet built by hand: rectangles of colour on grid meshes with a transparent margin, moved by known maps."""

from fractions import Fraction

import numpy as np

from wildpuppet.geometry.affine import apply, invert, scale_and_shift, similarity
from wildpuppet.types import Clip, Crops, Fit, Puppet

MARGIN = 4
CANVAS = (160, 120)
BODY = (40, 30, 60, 50)
ARM = (90, 40, 50, 20)
"""Rectangles of ink x, y, w, h on the canvas; the arm overlaps the body and is in front."""


def grid(left, top, width, height, cells=4):
    xs, ys = np.linspace(left, left + width, cells + 1), np.linspace(top, top + height, cells + 1)
    vertices = np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    first = corner + np.array([[0, 1, cells + 2]])
    second = corner + np.array([[0, cells + 2, cells + 1]])
    return vertices, np.concatenate([first, second])


def puppet(rectangles=(BODY, ARM), names=("body", "arm"), colours=((200, 60, 40), (40, 90, 200))):
    vertices, triangles, layers, uv, row = [], [], [], [], 0
    shelf = max(w for _, _, w, _ in rectangles) + 2 * MARGIN
    atlas = np.zeros((sum(h + 2 * MARGIN for *_, h in rectangles), shelf, 4), np.uint8)
    for layer, (x, y, w, h) in enumerate(rectangles):
        places, faces = grid(x - MARGIN, y - MARGIN, w + 2 * MARGIN, h + 2 * MARGIN)
        triangles.append(faces + sum(len(v) for v in vertices))
        vertices.append(places)
        layers.append(np.full(len(places), layer))
        uv.append(places - [x - MARGIN, y - MARGIN] + [0, row])
        inside = atlas[row + MARGIN : row + MARGIN + h, MARGIN : MARGIN + w]
        inside[...] = (*colours[layer], 255)
        row += h + 2 * MARGIN
    joints = np.zeros((0, 2, 3))
    return Puppet(
        names=tuple(names),
        canvas=CANVAS,
        vertices=np.concatenate(vertices),
        triangles=np.concatenate(triangles),
        layer_of_vertex=np.concatenate(layers),
        uv=np.concatenate(uv),
        atlas=atlas,
        joint_layers=np.zeros((0, 2), np.int64),
        joint_vertices=joints.astype(np.int64),
        joint_weights=joints,
        reference=0,
    )


def motion(num_frames):
    """Per frame a turn, a scale and a shift of each layer: video_from_canvas (T, L, 2, 3); frame 0 stays."""
    t = np.arange(num_frames, dtype=float)
    body = similarity(1.0 + 0.02 * t, 0.05 * t, np.stack([2.0 * t, -1.0 * t], -1))
    arm = similarity(1.0 - 0.01 * t, -0.1 * t, np.stack([3.0 * t, 8.0 * t], -1))
    return np.stack([body, arm], 1)


def posed(character, video_from_canvas, first=100, scale=1.5):
    """Crops and a fit that put the puppet exactly there; windows drift so that the crop maps matter."""
    num = len(video_from_canvas)
    video_from_crop = np.stack([scale_and_shift(1 / scale, (3.0 + i, 5.0 - i)) for i in range(num)])
    video = np.stack(
        [
            np.concatenate([apply(m, character.vertices[character.layer_of_vertex == k]) for k, m in enumerate(maps)])
            for maps in video_from_canvas
        ]
    )
    frames = np.arange(first, first + num)
    size = (int(CANVAS[0] * scale), int(CANVAS[1] * scale))
    crops = Crops(
        frames=frames,
        size=size,
        video_from_crop=video_from_crop,
        images=np.zeros((num, size[1], size[0], 4), np.uint8),
        box_crop=np.zeros((num, 4)),
        drawing=np.arange(num),
        shot=np.zeros(num, np.int64),
        state=("followed",) * num,
        reference=0,
    )
    fit = Fit(
        frames=frames,
        vertices_crop=apply(invert(video_from_crop), video),
        order=np.tile(np.arange(character.num_layers), (num, 1)),
        confidence=np.ones((num, len(character.vertices))),
        state=("fitted",) * num,
        losses={"total": np.linspace(1.0, 2.0, num)},
    )
    return crops, fit


def clip(path, num_frames=200, size=CANVAS):
    return Clip(path, "0" * 64, size, np.arange(num_frames) * 512, Fraction(1, 12288))
