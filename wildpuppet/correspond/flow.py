"""Dense maps from one frame to another through the puppet's visible surface.

Each video pixel that shows the puppet belongs to one triangle; its centre goes where the same mix of the triangle's
corners is in the other frame. Dense maps are computed when asked, never stored with the run.
"""

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float32

from wildpuppet.correspond import cover
from wildpuppet.correspond.carry import frame_index
from wildpuppet.errors import InputError, StoreError
from wildpuppet.geometry.affine import apply
from wildpuppet.render.render import mesh_of, texture_at
from wildpuppet.render.surface import surface
from wildpuppet.types import Crops, Fit, Puppet

FLO_UNKNOWN = 1.0e10
"""Middlebury's value for "no flow here"."""


class DenseFlow(NamedTuple):
    """``flow[y, x]`` is the move, in video pixels, of the point at the pixel's centre; NaN where no puppet is seen.

    ``visible[y, x]``: that point is also seen in the other frame: not covered, and inside the picture.
    """

    flow: Float32[np.ndarray, "H W 2"]
    visible: Bool[np.ndarray, "H W"]


def flow(puppet: Puppet, crops: Crops, fit: Fit, source: int, target: int, size: tuple[int, int]) -> DenseFlow:
    """Compute the flow from clip frame ``source`` to clip frame ``target`` at video size (W, H).

    All NaN where either frame has no character. Raises InputError for frames outside the run.
    """
    pair = [frame_index(fit, source), frame_index(fit, target)]
    width, height = size
    found = DenseFlow(np.full((height, width, 2), np.nan, np.float32), np.zeros((height, width), bool))
    if any(fit.state[index] == "lost" for index in pair):
        return found
    start, end = apply(crops.video_from_crop[pair], fit.vertices_crop[pair].astype(np.float64))
    seen = surface(
        torch.from_numpy(start[None].astype(np.float32)),
        mesh_of(puppet),
        texture_at(puppet, 1.0),
        torch.from_numpy(fit.order[pair[:1]].astype(np.int64)),
        size,
    )
    rows, columns = np.nonzero(seen.triangle[0].numpy() >= 0)
    triangle, weights = seen.triangle[0].numpy()[rows, columns], seen.barycentrics[0].numpy()[rows, columns]
    corners = puppet.triangles[triangle]
    found.flow[rows, columns] = np.einsum("nkd,nk->nd", (end - start)[corners], weights)
    places = np.einsum("nkd,nk->nd", end[corners], weights)
    hidden = cover.covered(
        end[None], puppet.triangles, puppet.layer_of_triangle, cover.rank_of(fit.order[pair[1:]]), puppet.uv,
        puppet.atlas[..., 3], places[None], puppet.layer_of_triangle[triangle],
    )[0]  # fmt: skip
    found.visible[rows, columns] = ~hidden & ((places >= 0.0) & (places < np.array(size, np.float64))).all(1)
    return found


def write_flow(path: Path, dense: DenseFlow) -> None:
    """Write ``.npz`` (flow (H, W, 2) f32 with NaN, visible (H, W) bool) or Middlebury ``.flo`` (1e10 where unknown).

    Written beside and renamed. Raises InputError for another suffix and StoreError where the disk refuses.
    """
    if path.suffix not in (".npz", ".flo"):
        raise InputError(f"{path}: expected a name that ends with .npz or .flo; give --out one of those")
    beside = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".flo":
            beside.write_bytes(_flo(dense))
        else:
            np.savez_compressed(beside, flow=dense.flow, visible=dense.visible)
        beside.replace(path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise StoreError(f"{path}: the dense map cannot be written ({error.strerror or error})") from None


def _flo(dense: DenseFlow) -> bytes:
    height, width = dense.visible.shape
    head = b"PIEH" + np.array([width, height], "<i4").tobytes()
    return head + bytes(np.nan_to_num(dense.flow, nan=FLO_UNKNOWN).astype("<f4").tobytes())
