"""The puppet's texture as one picture per part on the canvas, and back: which texels a person changed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, UInt8

from wildpuppet.export.sprites import AXES, atlas_window
from wildpuppet.geometry.topology import boundary_edges
from wildpuppet.puppet.atlas import bleed, border_texels
from wildpuppet.types import Puppet

Picture = UInt8[np.ndarray, "H W 4"]
Pictures = Mapping[str, Picture]

SAME = 2.5
"""Largest difference (0..255, premultiplied) of a texel that counts as unedited: programs round when they save."""
LOST_ALPHA = 64
"""Paint beyond a part's mesh is told of where it is at least so opaque."""

__all__ = ["AXES", "Edit", "Picture", "Pictures", "canvas_pictures", "differs", "edited"]


@dataclass(frozen=True, eq=False)
class Edit:
    """A puppet with edited texture; ``parts`` are those that differ, ``notes`` what a person should know.

    ``erases``: some paint was taken away, so that what lies behind the character shows.
    """

    puppet: Puppet
    parts: tuple[str, ...]
    erases: bool
    notes: tuple[str, ...] = ()


def differs(before: UInt8[np.ndarray, "h w 4"], after: UInt8[np.ndarray, "h w 4"]) -> Bool[np.ndarray, "h w"]:
    """Mark the pixels that look different; colour under no alpha does not count."""
    first, second = (
        np.dstack([picture[..., :3] * (picture[..., 3:] / np.float32(255.0)), picture[..., 3]])
        for picture in (before, after)
    )
    return np.asarray((np.abs(first - second) > SAME).any(-1))


def canvas_pictures(puppet: Puppet) -> dict[str, Picture]:
    """Give every part's texels where they are on the canvas at rest; what lies beyond the canvas is cut off."""
    pictures = {}
    for layer, name in enumerate(puppet.names):
        picture = np.zeros((puppet.canvas[1], puppet.canvas[0], 4), np.uint8)
        inside, texels = _windows(puppet, layer)
        picture[inside] = puppet.atlas[texels]
        picture[picture[..., 3] == 0] = 0
        pictures[name] = picture
    return pictures


def edited(puppet: Puppet, before: Pictures, after: Pictures) -> Edit:
    """Put what differs between a part's pictures before and after into the atlas; parts that are missing stay."""
    atlas, parts, notes, erases = puppet.atlas.copy(), [], [], False
    for layer, name in enumerate(puppet.names):
        if name not in after:
            continue
        changed = differs(before[name], after[name])
        if not changed.any():
            continue
        inside, texels = _windows(puppet, layer)
        touched = _at_border(puppet, layer, texels, inside)
        mine, mesh = changed[inside], ~touched
        window = atlas[texels].copy()
        window[mine & mesh] = after[name][inside][mine & mesh]
        erases |= bool((window[..., 3] + 8.0 < atlas[texels][..., 3]).any())
        lost = int(changed.sum() - (mine & mesh).sum() - _faint(after[name], changed, inside, mine & mesh))
        if lost > 0:
            notes.append(f"{name}: {lost} painted pixels lie beyond the part's mesh and are left out")
        if window[..., 3].any():
            window = bleed(window)
        atlas[texels] = window
        parts.append(name)
    return Edit(replace(puppet, atlas=atlas), tuple(parts), erases, tuple(notes))


def _faint(
    after: Picture, changed: Bool[np.ndarray, "H W"], inside: tuple[slice, slice], taken: Bool[np.ndarray, "h w"]
) -> int:
    """Count the changed pixels that were not taken and hardly show anyway."""
    left = changed.copy()
    left[inside] &= ~taken
    return int((left & (after[..., 3] < LOST_ALPHA)).sum())


def _windows(puppet: Puppet, layer: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Find a layer's rows and columns of the canvas and the same of the atlas, cut to the canvas."""
    x, y, width, height = atlas_window(puppet, layer)
    mine = np.flatnonzero(puppet.layer_of_vertex == layer)[0]
    left, top = np.rint(puppet.vertices[mine] - puppet.uv[mine]).astype(int).tolist()
    x0, y0 = max(x + left, 0), max(y + top, 0)
    x1, y1 = max(min(x + width + left, puppet.canvas[0]), x0), max(min(y + height + top, puppet.canvas[1]), y0)
    return (slice(y0, y1), slice(x0, x1)), (slice(y0 - top, y1 - top), slice(x0 - left, x1 - left))


def _at_border(
    puppet: Puppet, layer: int, texels: tuple[slice, slice], inside: tuple[slice, slice]
) -> Bool[np.ndarray, "h w"]:
    """Mark the texels of a window that the mesh border touches or that lie outside the mesh: alpha stays 0 there."""
    import cv2

    rows, columns = texels
    corner = np.array([columns.start, rows.start], np.float64)
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    triangles = puppet.triangles[puppet.layer_of_triangle == layer]
    covered = np.zeros(shape, np.uint8)
    for corners in puppet.uv[triangles] - corner:
        cv2.fillConvexPoly(covered, np.rint((corners - 0.5) * 16).astype(np.int32), 1, cv2.LINE_8, 4)
    edges = boundary_edges(triangles)
    touched = border_texels(shape, puppet.uv[edges[:, 0]] - corner, puppet.uv[edges[:, 1]] - corner)
    return np.asarray(touched | (covered == 0))
