"""What one frame says, ready to be compared: its colours in Lab and what each pixel costs when left unexplained.

One explanation per pixel. With a the puppet's coverage, C its colour there, I the frame's colour and m the matte, a
pixel costs

    a * (disagreement(I, C) + BEHIND * max(0, 1 - 2 m)) + (1 - a) * (m + cover * max(0, 2 m - 1))

so that claiming a foreground pixel with the wrong colour costs as much as leaving it unexplained (less by ``cover``,
where the matte is exact: some part must lie there, whatever it looks like), claiming background costs extra, and two
parts gain nothing by claiming the same pixel. Where the matte does not know (m = 0.5) a pixel is worth claiming with a
colour that agrees: without that a puppet would shrink wherever the background is unknown.
Disagreement grows about linearly with the Lab distance, so that the shade by which a far leg differs from the near one
counts, and is bounded by 1, so that a face that changes does not drag the body along.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from wildpuppet.pose.kernels import composite_costs
from wildpuppet.puppet.colour import lab
from wildpuppet.render.render import Mesh, render
from wildpuppet.render.texture import Texture

BEHIND = 1.0
SIGMA = 15.0
"""Lab distance at which a pixel is about 60 % wrong."""
SMOOTH = 4.0
"""Lab distance below which disagreement is quadratic: noise and resampling."""
LAB_UNIT = 100.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """One frame at search scale: Lab colours and the matte (1 character, 0 background, 0.5 unknown).

    ``cover`` is what a pixel that is surely the character's costs beside 1 when no part explains it.
    """

    lab: Float[np.ndarray, "H W 3"]
    matte: Float[np.ndarray, "H W"]
    cover: float = 0.0

    @cached_property
    def unexplained(self) -> Float[np.ndarray, "H W"]:
        """Price of leaving each pixel unexplained."""
        price: Float[np.ndarray, "H W"] = self.matte + self.cover * np.maximum(2 * self.matte - 1, 0)
        return price


def evidence_of(image: UInt8[np.ndarray, "H W 4"], scale: float, cover: float = 0.0) -> Evidence:
    """Shrink a crop to search scale (search pixels per crop pixel)."""
    height, width = image.shape[:2]
    size = (max(8, round(width * scale)), max(8, round(height * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    return Evidence(lab(small[..., :3]), small[..., 3], cover)


def disagreement(squared: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Turn squared Lab distances into 0..1: nearly linear from small shades on, bounded by 1."""
    share: Float[np.ndarray, "*shape"] = 1 - np.exp(-(np.sqrt(squared + SMOOTH**2) - SMOOTH) / SIGMA)
    return share


def behind_cost(matte: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Price of claiming a pixel that the matte gives to the background."""
    price: Float[np.ndarray, "*shape"] = BEHIND * np.maximum(1 - 2 * matte, 0)
    return price


def colours_wrong(evidence: Evidence, palette: Float[np.ndarray, "C 3"]) -> Float[np.ndarray, "C H W"]:
    """Tell how badly each pixel disagrees with each palette colour, 0..1."""
    return disagreement(((evidence.lab[None] - palette[:, None, None]) ** 2).sum(-1))


def disagreement_maps(
    evidence: Evidence, wrong: Float[np.ndarray, "C H W"], reach: int
) -> Float[np.ndarray, "C Hp Wp"]:
    """Cost of claiming each pixel for each palette colour, relative to leaving it, padded by ``reach``.

    ``wrong`` comes from ``colours_wrong``.
    """
    gain = wrong + behind_cost(evidence.matte) - evidence.unexplained
    padded = np.pad(gain, ((0, 0), (reach, reach), (reach, reach)), constant_values=BEHIND)
    return np.ascontiguousarray(padded, np.float32)


def lab_texture(texture: Texture) -> Texture:
    """Turn a premultiplied RGB texture into premultiplied Lab (in units of 100)."""
    rgba = texture.rgba.numpy()
    colour = (rgba[..., :3] / rgba[..., 3:].clip(1e-3)).clip(0, 1)
    turned = np.concatenate([lab(colour) / LAB_UNIT * rgba[..., 3:], rgba[..., 3:]], -1)
    return texture._replace(rgba=torch.from_numpy(turned.astype(np.float32)))


def unexplained_cost(
    evidence: Evidence,
    vertices: Float[np.ndarray, "B V 2"],
    order: Int[np.ndarray, "B L"],
    mesh: Mesh,
    texture: Texture,
) -> Float[np.ndarray, "B"]:
    """Sum the cost above over the frame for B poses given in search pixels; ``texture`` is a ``lab_texture``."""
    height, width = evidence.matte.shape
    with torch.no_grad():
        picture = render(
            torch.from_numpy(np.ascontiguousarray(vertices, np.float32)),
            mesh,
            texture,
            torch.from_numpy(np.ascontiguousarray(order)),
            (width, height),
        ).rgba.numpy()
    rows: Float[np.ndarray, "B H"] = composite_costs(
        picture, evidence.lab, behind_cost(evidence.matte), evidence.unexplained, LAB_UNIT, WRONG, PER_STEP
    )
    costs: Float[np.ndarray, "B"] = rows.sum(1)
    return costs


PER_STEP = 0.5
WRONG = disagreement(((np.arange(round(PER_STEP * (6 * SIGMA + SMOOTH) ** 2)) + 0.5) / PER_STEP).astype(np.float32))
"""Disagreement at squared Lab distances of 1, 3, 5, ...: the composite's cost is looked up."""
