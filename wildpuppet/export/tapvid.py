"""TAP-Vid point tracks as .npz: a grid of points on the puppet in every frame, and whether each is hidden.

| array | shape | what |
|---|---|---|
| ``points`` | (N, T, 2) f32 | x / W, y / H: 0 is the picture's left or upper border, 1 the right or lower |
| ``occluded`` | (N, T) bool | hidden by another part, outside the picture, or in a frame where the character is lost |
| ``query_points`` | (N, 3) f32 | index of the frame in which it is seen first, y, x: pixels |
| ``confidence`` | (N, T) f32 | how sure the mesh is there, 0..1 |
| ``part`` | (N,) str | the part it lies on |
| ``frames``, ``size`` | (T,) i64, (2,) i64 | clip frame numbers; W, H |

TAP-Vid's own loader multiplies by (W, H), and so is this; CoTracker's multiplies by (W - 1, H - 1): for it, give
(points * size - 0.5) / (size - 1). ``video`` (T, H, W, 3) u8 RGB is there where the export was given pictures.
"""

import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.disk import FIRST_DATE, write_arrays
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest, rounding_error
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options, Pictures
from wildpuppet.machine import Progress
from wildpuppet.types import Puppet

SCHEMA = "wildpuppet.tapvid/1"
MOST_POINTS = 1024
"""About how many points the grid has over all parts. More are closer together, and the file grows with them."""


class Grid(NamedTuple):
    """Points that sit on the puppet: each a mix of three vertices of its layer."""

    layer: Int[np.ndarray, "N"]
    corners: Int[np.ndarray, "N 3"]
    weights: Float[np.ndarray, "N 3"]


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.npz; points that are never seen are left out."""
    grid = grid_on(animation.puppet, MOST_POINTS)
    size = np.array(animation.size)
    points = np.zeros((len(grid.layer), len(animation), 2), np.float32)
    confidence = np.zeros(points.shape[:2], np.float32)
    occluded = np.ones(points.shape[:2], bool)
    for t, frame in enumerate(animation):
        places = np.einsum("nkd,nk->nd", frame.vertices[grid.corners], grid.weights)
        points[:, t] = places / size
        confidence[:, t] = (animation.confidence[t][grid.corners] * grid.weights).sum(1)
        if frame.is_visible:
            inside = ((places >= 0.0) & (places < size)).all(1)
            occluded[:, t] = ~inside | _hidden(animation.puppet, frame.vertices, frame.order, places, grid.layer)
        progress(t + 1, len(animation))
    kept = ~occluded.all(1)
    points, occluded = points[kept], occluded[kept]
    arrays = {
        "points": points,
        "occluded": occluded,
        "confidence": np.clip(confidence[kept], 0.0, 1.0),
        "query_points": _queries(points, occluded, size),
        "part": np.array(animation.puppet.names, np.str_)[grid.layer[kept]],
        "frames": animation.frames.astype(np.int64),
        "size": size.astype(np.int64),
    }
    path = folder / f"{file_names([animation.name])[0]}.npz"
    write_arrays(path, SCHEMA, arrays)
    left_out: tuple[str, ...] = ("meshes, textures, order of parts",)
    if options.pictures is None:
        left_out = ("pictures (TAP-Vid's `video`): --pictures True puts them in", *left_out)
    else:
        _add_video(path, animation, options.pictures)
    first = int(animation.frames[0])
    error = rounding_error(animation, lambda places: (places / size).astype(np.float32) * size.astype(np.float64))
    return Manifest("top left corner of the picture", "x right, y down, shares of W and H", first, 1.0, left_out, error)


def _add_video(path: Path, animation: Animation, pictures: Pictures) -> None:
    """Add the pictures to an .npz, one at a time."""
    width, height = animation.size
    header = {"descr": "|u1", "fortran_order": False, "shape": (len(animation), height, width, 3)}
    info = zipfile.ZipInfo("video.npy", FIRST_DATE)
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_STORED) as archive,
        archive.open(info, "w", force_zip64=True) as member,
    ):
        np.lib.format.write_array_header_2_0(member, header)
        for frame in animation:
            member.write(np.ascontiguousarray(pictures(frame.number), np.uint8).tobytes())


def grid_on(puppet: Puppet, most: int) -> Grid:
    """Lay an even grid over the canvas at rest and keep, for each part, the points on its opaque texels."""
    from wildpuppet.correspond import cover

    opaque = puppet.atlas[..., 3] > cover.OPAQUE
    step = max(float(np.sqrt(opaque.sum() / max(most, 1))), 1.0)
    spots = [_spots(puppet, layer, opaque, step) for layer in range(puppet.num_layers)]
    points, layer = np.concatenate(spots), np.repeat(np.arange(puppet.num_layers), [len(some) for some in spots])
    triangle = cover.frontmost(
        puppet.vertices, puppet.triangles, puppet.layer_of_triangle, np.arange(puppet.num_layers, dtype=np.float64),
        puppet.uv, puppet.atlas[..., 3], points, layer,
    )  # fmt: skip
    on = triangle >= 0
    corners = puppet.triangles[triangle[on]].astype(np.int64)
    return Grid(layer[on].astype(np.int64), corners, cover.barycentrics(puppet.vertices, corners, points[on]))


def _spots(puppet: Puppet, layer: int, opaque: Bool[np.ndarray, "H W"], step: float) -> Float[np.ndarray, "n 2"]:
    mine = puppet.layer_of_vertex == layer
    vertices = puppet.vertices[mine].astype(np.float64)
    low, high = np.floor(vertices.min(0) / step), np.ceil(vertices.max(0) / step)
    x, y = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True)))
    spots = np.stack([x, y], -1).reshape(-1, 2) * step
    texel = np.floor(spots - (vertices - puppet.uv[mine])[0]).astype(int)
    inside = ((texel >= 0) & (texel < opaque.shape[::-1])).all(1)
    spots, texel = spots[inside], texel[inside]
    return np.asarray(spots[opaque[texel[:, 1], texel[:, 0]]])


def _hidden(
    puppet: Puppet,
    vertices: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
    places: Float[np.ndarray, "N 2"],
    layer: Int[np.ndarray, "N"],
) -> Bool[np.ndarray, "N"]:
    from wildpuppet.correspond import cover

    found = cover.covered(
        vertices[None], puppet.triangles, puppet.layer_of_triangle, cover.rank_of(order[None]), puppet.uv,
        puppet.atlas[..., 3], places[None], layer,
    )  # fmt: skip
    return np.asarray(found[0])


def _queries(
    points: Float[np.ndarray, "N T 2"], occluded: Bool[np.ndarray, "N T"], size: Int[np.ndarray, "2"]
) -> Float[np.ndarray, "N 3"]:
    first = occluded.argmin(1)
    places = points[np.arange(len(points)), first] * size
    return np.column_stack([first, places[:, 1], places[:, 0]]).astype(np.float32)
