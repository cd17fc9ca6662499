"""A cut-out becomes a puppet: every part a triangle mesh, all textures in one atlas, every joint two mesh points.

A part's mesh reaches ``margin`` canvas pixels beyond the drawing: the texture's own alpha makes the edge, and the
picture stays continuous in the vertices (Neural Puppet, section 3.1, with a matte in place of a hard outline).
"""

import logging
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy import ndimage

from wildpuppet.errors import PuppetError
from wildpuppet.geometry.topology import boundary_edges, subdivide
from wildpuppet.geometry.triangulate import triangulate
from wildpuppet.puppet.atlas import assemble, bleed, border_texels, cut_window, shelf_pack, window_of
from wildpuppet.puppet.bends import with_bends
from wildpuppet.puppet.contours import rings_around
from wildpuppet.puppet.copies import without_copies
from wildpuppet.puppet.joints import attach, joint_positions
from wildpuppet.puppet.silhouette import Silhouette, silhouette_of
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import CutOut, Part, Puppet

_logger = logging.getLogger(__name__)

TOLERANCE_SHARE = 0.1
"""Corners of a mesh border lie within about this share of the target edge of the grown silhouette."""
PART_EDGES = 2.5
"""A part is at least this many edges long, so that small parts get finer meshes."""
SPECK_SHARE = 0.015
"""An island smaller than the square on this share of the character's larger side may be a speck."""
FRINGE = 3
"""Pixels around the kept islands whose alpha, however faint, stays in the texture."""


@dataclass(frozen=True, eq=False)
class _Layer:
    vertices: Float[np.ndarray, "V 2"]
    triangles: Int[np.ndarray, "F 3"]
    window: tuple[int, int, int, int]
    texture: UInt8[np.ndarray, "h w 4"]


def build(cutout: CutOut, settings: PuppetSettings) -> Puppet:
    """Mesh a cut-out puppet.

    Joints keep the order of the cut-out. Where a joint lies outside a part's mesh, its point there is extrapolated from
    the nearest triangle, so that both points of every joint coincide at rest.

    Raises:
        PuppetError: a part has no pixel of at least ``settings.least_alpha``.
    """
    side = rest_side(cutout, settings.least_alpha)
    cutout = without_copies(cutout, settings.least_alpha)
    layers = [_layer(part, side, settings) for part in cutout.parts]
    starts = np.cumsum([0] + [len(layer.vertices) for layer in layers])
    vertices = np.concatenate([layer.vertices for layer in layers])
    triangles = np.concatenate([layer.triangles + start for layer, start in zip(layers, starts, strict=False)])
    layer_of_vertex = np.repeat(np.arange(len(layers)), np.diff(starts))
    size, corners = shelf_pack(np.array([layer.window[2:] for layer in layers]))
    shift = corners - np.array([layer.window[:2] for layer in layers])
    joint_layers, joint_vertices, joint_weights = _joints(cutout, layers, starts, settings)
    puppet = Puppet(
        names=tuple(part.name for part in cutout.parts),
        canvas=cutout.canvas,
        vertices=vertices,
        triangles=triangles,
        layer_of_vertex=layer_of_vertex,
        uv=vertices + shift[layer_of_vertex],
        atlas=assemble(size, [layer.texture for layer in layers], corners),
        joint_layers=joint_layers,
        joint_vertices=joint_vertices,
        joint_weights=joint_weights,
        reference=cutout.reference,
    )
    return with_bends(puppet, settings.slender)


def rest_box(cutout: CutOut, least_alpha: int) -> tuple[float, float, float, float]:
    """Find the box x, y, w, h of all parts' drawn pixels on the canvas.

    Raises:
        PuppetError: a part has no pixel of at least ``least_alpha``.
    """
    lows, highs = [], []
    for part in cutout.parts:
        rows, columns = np.nonzero(part.rgba[..., 3] >= least_alpha)
        if not len(rows):
            raise _empty(part.name, least_alpha)
        lows.append((columns.min(), rows.min()))
        highs.append((columns.max() + 1, rows.max() + 1))
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def rest_side(cutout: CutOut, least_alpha: int) -> float:
    """Measure the larger side of the character's rest box, the unit of the mesh settings."""
    return max(rest_box(cutout, least_alpha)[2:])


def part_silhouette(part: Part, side: float, settings: PuppetSettings) -> Silhouette:
    """Clean a part's covered area as ``build`` does; ``side`` is the character's larger side."""
    edge = settings.edge * side
    found = silhouette_of(
        part.rgba[..., 3],
        least_alpha=settings.least_alpha,
        pinhole=edge**2,
        speck=(SPECK_SHARE * side) ** 2,
        bridge=settings.bridge * side,
    )
    if found is None:
        raise _empty(part.name, settings.least_alpha)
    return found


def _empty(name: str, least_alpha: int) -> PuppetError:
    return PuppetError(f"puppet part {name!r}: no pixel with alpha of at least {least_alpha}; draw or remove it")


def _layer(part: Part, side: float, settings: PuppetSettings) -> _Layer:
    area = part_silhouette(part, side, settings)
    if area.num_specks:
        _logger.info("part %r: %d speck(s) dropped", part.name, area.num_specks)
    edge = min(settings.edge * side, (max(area.mask.shape) + 2.0 * settings.margin) / PART_EDGES)
    rings = rings_around(area.mask, margin=settings.margin, tolerance=TOLERANCE_SHARE * edge, least_hole=edge**2)
    rings = [ring + np.array(area.origin, np.float64) for ring in rings]
    vertices, triangles = triangulate(rings, edge=edge, least_angle=settings.least_angle)
    for _ in range(settings.subdivide):
        vertices, triangles, _ = subdivide(vertices, triangles)
    window = window_of(vertices)
    return _Layer(vertices, triangles, window, _texture(part, area, vertices, triangles, window))


def _texture(
    part: Part,
    area: Silhouette,
    vertices: Float[np.ndarray, "V 2"],
    triangles: Int[np.ndarray, "F 3"],
    window: tuple[int, int, int, int],
) -> UInt8[np.ndarray, "h w 4"]:
    """Cut a part's picture: alpha of dropped specks and of texels that the mesh border touches is 0."""
    x, y, w, h = window
    texture = cut_window(part.rgba, window)
    drawn = np.zeros((h, w), bool)
    top, left = area.origin[1] - y, area.origin[0] - x
    drawn[top : top + area.drawn.shape[0], left : left + area.drawn.shape[1]] = area.drawn
    kept = ndimage.binary_dilation(drawn, iterations=FRINGE)
    edges = boundary_edges(triangles)
    local = vertices - np.array([x, y])
    touched = border_texels((h, w), local[edges[:, 0]], local[edges[:, 1]])
    texture[..., 3][~kept | touched] = 0
    return bleed(texture)


def _joints(
    cutout: CutOut, layers: list[_Layer], starts: Int[np.ndarray, "M"], settings: PuppetSettings
) -> tuple[Int[np.ndarray, "J 2"], Int[np.ndarray, "J 2 3"], Float[np.ndarray, "J 2 3"]]:
    number = {part.name: index for index, part in enumerate(cutout.parts)}
    count = len(cutout.joints)
    ends = np.array([[number[name] for name in joint.parts] for joint in cutout.joints], np.int64).reshape(count, 2)
    held, weights = np.zeros((count, 2, 3), np.int64), np.zeros((count, 2, 3))
    for j, place in enumerate(joint_positions(cutout, settings.least_alpha)):
        for k, layer in enumerate(ends[j]):
            corners, mix = attach(place, layers[layer].vertices, layers[layer].triangles)
            held[j, k], weights[j, k] = corners + starts[layer], mix
    return ends, held, weights
