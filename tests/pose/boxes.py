"""A puppet of flat boxes on one canvas and crops around it: small enough to work out by hand."""

from collections.abc import Sequence

import numpy as np

from wildpuppet.types import Crops, Puppet

MARGIN = 3
Box = tuple[int, int, int, int]
Hinge = tuple[int, int, tuple[float, float]]
COLOURS = ((200, 40, 40), (40, 160, 60), (50, 60, 210), (220, 200, 40), (150, 60, 170), (30, 30, 30))


def box_puppet(
    boxes: Sequence[Box],
    hinges: Sequence[Hinge] = (),
    canvas: tuple[int, int] = (64, 48),
    colours: Sequence[tuple[int, int, int]] = COLOURS,
) -> Puppet:
    """One layer per box (x, y, w, h): two triangles that reach ``MARGIN`` beyond it, one flat colour.

    The atlas stacks one canvas per layer.
    """
    width, height = canvas
    atlas = np.zeros((height * len(boxes), width, 4), np.uint8)
    vertices = np.concatenate([_corners(box) for box in boxes])
    for layer, (x, y, w, h) in enumerate(boxes):
        atlas[layer * height : (layer + 1) * height, :, :3] = colours[layer % len(colours)]
        atlas[layer * height + y : layer * height + y + h, x : x + w, 3] = 255
    layer_of_vertex = np.repeat(np.arange(len(boxes)), 4)
    shift = np.stack([np.zeros(len(boxes)), height * np.arange(len(boxes))], -1)
    ends = np.array([hinge[:2] for hinge in hinges], np.int64).reshape(-1, 2)
    weights = [[_barycentric(vertices[4 * a : 4 * a + 3], at) for a in (first, second)] for first, second, at in hinges]
    return Puppet(
        names=tuple(f"box{layer}" for layer in range(len(boxes))),
        canvas=canvas,
        vertices=vertices,
        triangles=np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * layer for layer in range(len(boxes))]),
        layer_of_vertex=layer_of_vertex,
        uv=vertices + shift[layer_of_vertex],
        atlas=atlas,
        joint_layers=ends,
        joint_vertices=4 * ends[:, :, None] + np.arange(3),
        joint_weights=np.array(weights, float).reshape(-1, 2, 3),
    )


def _corners(box: Box) -> np.ndarray:
    x, y, w, h = box
    left, top, right, bottom = x - MARGIN, y - MARGIN, x + w + MARGIN, y + h + MARGIN
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)


def _barycentric(corners: np.ndarray, at: tuple[float, float]) -> np.ndarray:
    return np.linalg.solve(np.vstack([corners.T, np.ones(3)]), [*at, 1.0])


def crops_around(
    num: int,
    size: tuple[int, int] = (64, 48),
    *,
    box: Box = (16, 12, 32, 24),
    video_from_crop: np.ndarray | None = None,
    drawing: Sequence[int] | None = None,
    shot: Sequence[int] | None = None,
    ordered: bool = True,
) -> Crops:
    """``num`` empty crops, the character's box the same in each; every frame a drawing of its own unless said."""
    identity = np.tile(np.array([[1.0, 0, 0], [0, 1.0, 0]]), (num, 1, 1))
    return Crops(
        frames=np.arange(num),
        size=size,
        video_from_crop=identity if video_from_crop is None else video_from_crop,
        images=np.zeros((num, size[1], size[0], 4), np.uint8),
        box_crop=np.tile(np.array(box, float), (num, 1)),
        drawing=np.arange(num) if drawing is None else np.array(drawing),
        shot=np.zeros(num, np.int64) if shot is None else np.array(shot),
        state=("followed",) * num,
        reference=0 if ordered else None,
        ordered=ordered,
    )
