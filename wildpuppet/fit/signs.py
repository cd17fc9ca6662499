"""What speaks for a vertex being where the fit has it: numbers without units, small when something is wrong there.

All is seen at one size, the puppet ``PIXELS`` large, so that signs of different clips compare. In the picture, with the
cost of ``pose/evidence.py`` per pixel (colours that disagree, background covered, character left uncovered):

- ``worth``: how much better the frame is explained with the vertex's part than without it, over its seen pixels. A part
  on the wrong place explains nothing that what lies behind it would not explain as well.
- ``agreement``: one minus how badly the colours disagree, over the part and over the puppet.
- ``explained``: minus the sure character pixels around that no part covers.
- ``seen``: share of the part that is not covered by others.

From the search, ``margin``: how much more the best pose costs that has this vertex elsewhere, per pixel that moves; a
limb taken for its twin shows here. From time, ``steady``: minus how far the vertex is from midway between the drawings
before and after. How wide hinges gape and how far out on a limb a vertex lies was measured too: it says nothing more.
"""

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from wildpuppet.fit.witness import PIXELS, SeenPixels, Witness, seen_pixels, size_in
from wildpuppet.pose import evidence as ev
from wildpuppet.pose.place import pose_vertices
from wildpuppet.render.render import render
from wildpuppet.render.surface import surface
from wildpuppet.render.texture import Texture

NEARBY = 0.05
"""The same in the picture, for what no part covers."""
ELSEWHERE = 0.05
"""From which distance a hypothesis has a vertex elsewhere, as a share of the character's size."""
MOVED = 0.3
"""Share of a part's vertices that are elsewhere from which the part counts as moved."""

BOUNDS = {
    "worth": (-1.0, 1.0),
    "worth_of_part": (-1.0, 1.0),
    "agreement_of_part": (0.0, 1.0),
    "agreement_of_all": (0.0, 1.0),
    "explained": (-0.5, 0.0),
    "explained_by_part": (-0.5, 0.0),
    "seen": (0.0, 1.0),
    "seen_of_part": (0.0, 1.0),
    "margin": (-0.3, 0.5),
    "steady": (-0.1, 0.0),
}
"""Bounds of each sign, in the order of the last axis: beyond them more says no more."""
NAMES = tuple(BOUNDS)
LOW, HIGH = np.array(list(BOUNDS.values())).T


def picture_signs(
    witness: Witness,
    image: UInt8[np.ndarray, "H W 4"],
    vertices: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
) -> dict[str, Float[np.ndarray, "V"]]:
    """Compare one crop with the puppet drawn into it; ``vertices`` in crop pixels."""
    size = size_in(witness, vertices)
    evidence = ev.evidence_of(image, PIXELS / size)
    height, width = evidence.matte.shape
    placed = (vertices * (np.array([width, height]) / image.shape[1::-1])).astype(np.float32)
    texture = witness.texture(PIXELS / witness.size)
    pictures, pixels = _pictures(witness, placed, order, texture, (width, height))
    with_all = _cost(evidence, pictures[0][pixels.rows, pixels.columns], pixels)
    without = _cost(evidence, pictures[1 + pixels.layer, pixels.rows, pixels.columns], pixels)
    uncovered = np.maximum(2 * evidence.matte - 1, 0) * (1 - pictures[0][..., 3])
    nearby = cv2.GaussianBlur(uncovered.astype(np.float32), (0, 0), NEARBY * PIXELS)
    columns, rows = placed.astype(int).clip(0, (width - 1, height - 1)).T
    return _of_vertices(witness, pixels, with_all, without.sum(0) - with_all.sum(0), nearby[rows, columns])


def _pictures(
    witness: Witness,
    placed: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
    texture: Texture,
    size: tuple[int, int],
) -> tuple[Float[np.ndarray, "_ H W 4"], SeenPixels]:
    """Draw the puppet whole, then without each layer in turn; and say where each layer is seen in the whole."""
    num_layers = len(order)
    opacity = 1 - torch.eye(num_layers + 1, num_layers + 1)[:, 1:]
    orders = torch.from_numpy(np.repeat(order[None], num_layers + 1, 0)).long()
    vertices = torch.from_numpy(placed).expand(num_layers + 1, -1, -1).contiguous()
    with torch.no_grad():
        pictures = render(vertices, witness.mesh, texture, orders, size, opacity).rgba.numpy()
    return pictures, seen_pixels(surface(vertices[:1], witness.mesh, texture, orders[:1], size))


def _cost(evidence: ev.Evidence, shown: Float[np.ndarray, "n 4"], pixels: SeenPixels) -> Float[np.ndarray, "2 n"]:
    """Cost of the seen pixels when ``shown`` (premultiplied Lab) is drawn there: of its colour, and of its cover."""
    alpha, matte = shown[:, 3], evidence.matte[pixels.rows, pixels.columns]
    colour = shown[:, :3] / np.maximum(alpha, 1e-3)[:, None] * ev.LAB_UNIT
    wrong = ev.disagreement(((colour - evidence.lab[pixels.rows, pixels.columns]) ** 2).sum(1))
    cover = alpha * ev.behind_cost(matte) + (1 - alpha) * matte
    return np.stack([alpha * wrong, cover]).astype(np.float64)


def _of_vertices(
    witness: Witness,
    pixels: SeenPixels,
    cost: Float[np.ndarray, "2 n"],
    worth: Float[np.ndarray, "n"],
    uncovered: Float[np.ndarray, "V"],
) -> dict[str, Float[np.ndarray, "V"]]:
    """Average over the pixels around each vertex, and over its part."""
    layers = witness.puppet.layer_of_vertex
    number = witness.spread(np.ones(len(worth)), pixels)

    def local(values: Float[np.ndarray, "V"]) -> Float[np.ndarray, "V"]:
        return np.asarray(witness.around @ values / (witness.around @ number + 1.0))

    def of_part(values: Float[np.ndarray, "V"]) -> Float[np.ndarray, "V"]:
        return np.asarray((witness.per_layer(values) / (witness.per_layer(number) + 1.0))[layers])

    gain, wrong = witness.spread(worth, pixels), witness.spread(cost[0], pixels)
    whole = witness.pixels_at_rest
    seen = np.asarray(witness.around @ number / (witness.around @ whole + 1.0))
    return {
        "worth": local(gain),
        "worth_of_part": of_part(gain),
        "agreement_of_part": 1 - of_part(wrong),
        "agreement_of_all": np.full(len(layers), 1 - wrong.sum() / max(number.sum(), 1.0)),
        "explained": -uncovered,
        "explained_by_part": -of_part(number * uncovered),
        "seen": seen,
        "seen_of_part": (witness.per_layer(number) / (witness.per_layer(whole) + 1.0))[layers],
    }


def margin_of(
    witness: Witness,
    crop_from_canvas: Float[np.ndarray, "N P 2 3"],
    cost: Float[np.ndarray, "N"],
    chosen: Float[np.ndarray, "P 2 3"],
    seen_of_part: Float[np.ndarray, "V"],
) -> Float[np.ndarray, "V"]:
    """Give the extra cost, per pixel that moves, of the best hypothesis that has each vertex elsewhere.

    Negative where a better-looking pose was overruled; the sign's upper bound where no hypothesis moves the vertex.
    """
    puppet = witness.puppet
    own = int(np.abs(crop_from_canvas - chosen).max((1, 2, 3)).argmin())
    placed = pose_vertices(puppet, crop_from_canvas)
    size = size_in(witness, placed[own])
    is_elsewhere = np.linalg.norm(placed - placed[own], axis=-1) > ELSEWHERE * size
    moved = _moved_layers(witness, is_elsewhere)
    seen_area = witness.areas * np.minimum(
        witness.per_layer(seen_of_part) / witness.per_layer(np.ones(len(seen_of_part))), 1
    )
    unit = np.sqrt(witness.areas).sum() / np.sqrt(witness.areas.mean()) / witness.areas.sum()
    evidence = (moved * seen_area).sum(1) * unit + 0.05
    extra = np.where(np.isfinite(cost), (cost - cost[own]) / evidence, np.inf)
    top = BOUNDS["margin"][1]
    return np.asarray(np.where(is_elsewhere, extra[:, None], top).min(0).clip(None, top))


def _moved_layers(witness: Witness, is_elsewhere: Bool[np.ndarray, "N V"]) -> Bool[np.ndarray, "N L"]:
    whole = witness.per_layer(np.ones(is_elsewhere.shape[1]))
    return np.stack([witness.per_layer(row.astype(np.float64)) > MOVED * whole for row in is_elsewhere])
