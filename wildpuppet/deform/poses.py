"""Self-made training data: the puppet's own renders in plausible poses around the fitted ones, with exact vertices.

A pose is a skeleton's vector (``skeleton.py``), mixed from fitted ones: a point between two of them, some limbs taken
from a third, every turn, size, shift and bend then varied by its own spread and a little beyond. Draw order comes
from the fits, with neighbours swapped at times. Pictures are small: the puppet over white paper or over backgrounds
of its own clip, with occluders, in changing light, at changing sharpness.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from wildpuppet.deform.skeleton import Skeleton
from wildpuppet.render.render import Mesh, Texture, render

BEYOND = 0.5
"""Share of a number's own spread over the fits by which it is varied further."""
LEAST_TURN, LEAST_SIZE, LEAST_SHIFT, LEAST_BEND = 0.12, 0.012, 0.006, 0.02
"""Least variations: radians, log-size, puppet sizes, bends."""
ROOT_TURN, ROOT_SIZE, ROOT_SHIFT = 0.06, 0.06, 0.08
"""How the character as a whole is varied beyond that: radians, log-size, unit coordinates (2 are the crop's side)."""
TAKEN_LIMBS = 0.3
"""Probability that a part (and what hangs from it, each again with this probability) is posed as in another frame."""
SWAPPED = 0.2
"""Probability that two neighbours of the draw order change places in a picture."""
OCCLUDED = 0.25
"""Probability of an occluder in a picture of a clip; on paper there are none."""


@dataclass(frozen=True, eq=False)
class Known:
    """The fitted poses that others are made around, their draw orders, and the spread of each number.

    ``part[p]`` is the part that number p of a pose belongs to.
    """

    poses: Float[np.ndarray, "N P"]
    orders: Int[np.ndarray, "N L"]
    spread: Float[np.ndarray, "P"]
    part: Int[np.ndarray, "P"]
    root: int


def known_poses(skeleton: Skeleton, poses: Float[np.ndarray, "N P"], orders: Int[np.ndarray, "N L"]) -> Known:
    """Measure the spread of fitted poses; one alone is varied by the least variations."""
    count = skeleton.num_layers
    least = np.concatenate(
        [
            np.full(count, LEAST_TURN),
            np.full(count, LEAST_SIZE),
            np.full(2 * count, LEAST_SHIFT),
            np.full(len(skeleton.bends), LEAST_BEND),
        ]
    )
    spread = np.sqrt((BEYOND * poses.std(0)) ** 2 + least**2)
    root = int(np.flatnonzero(skeleton.is_above.sum(1) == 1)[0])
    spread[[root, count + root]] = ROOT_TURN, ROOT_SIZE
    spread[[2 * count + 2 * root, 2 * count + 2 * root + 1]] = ROOT_SHIFT
    owner = [skeleton.layer_of_vertex[np.abs(bend).sum(1).argmax()] for bend in skeleton.bends]
    layers = np.arange(count)
    part = np.concatenate([layers, layers, np.repeat(layers, 2), np.array(owner, np.int64)])
    return Known(poses, orders, spread, part, root)


def sample_poses(known: Known, number: int, random: np.random.Generator) -> Float[np.ndarray, "n P"]:
    """Make plausible poses."""
    one, two, three = (random.integers(len(known.poses), size=number) for _ in range(3))
    share = np.where(random.random(number) < 0.5, 0.0, random.random(number))[:, None]
    mixed = (1.0 - share) * known.poses[one] + share * known.poses[two]
    count = known.orders.shape[1]
    is_taken = (random.random((number, count)) < TAKEN_LIMBS) & (random.random((number, 1)) < 0.5)
    is_taken[:, known.root] = False
    mixed = np.where(is_taken[:, known.part], known.poses[three], mixed)
    strength = random.choice([0.3, 1.0, 1.6], size=(number, 1))
    return np.asarray(mixed + strength * known.spread * random.standard_normal(mixed.shape))


def sample_orders(known: Known, number: int, random: np.random.Generator) -> Int[np.ndarray, "n L"]:
    """Take draw orders of the fits, at times with two neighbours swapped."""
    orders = np.array(known.orders[random.integers(len(known.orders), size=number)])
    place = random.integers(max(orders.shape[1] - 1, 1), size=number)
    for row in np.flatnonzero(random.random(number) < SWAPPED):
        pair = orders[row, place[row] : place[row] + 2]
        orders[row, place[row] : place[row] + 2] = pair[::-1]
    return np.asarray(orders)


@dataclass(frozen=True, eq=False)
class Studio:
    """What pictures are made of: the mesh, its texture at the small scale, backgrounds of the small size (w, h)."""

    mesh: Mesh
    texture: Texture
    backgrounds: UInt8[np.ndarray, "n h w 3"]
    is_on_paper: bool

    @property
    def size(self) -> tuple[int, int]:
        """(w, h) of the pictures."""
        height, width = self.backgrounds.shape[1:3]
        return width, height


def draw(
    studio: Studio,
    vertices: Float[np.ndarray, "n V 2"],
    orders: Int[np.ndarray, "n L"],
    random: np.random.Generator,
) -> UInt8[np.ndarray, "n h w 3"]:
    """Draw the puppet; ``vertices`` in pixels of the small pictures."""
    placed = torch.from_numpy(np.ascontiguousarray(vertices, np.float32))
    with torch.no_grad():
        rgba = render(placed, studio.mesh, studio.texture, torch.from_numpy(orders).long(), studio.size).rgba.numpy()
    pictures = np.empty((*rgba.shape[:3], 3), np.uint8)
    for row, front in enumerate(rgba):
        behind = _background(studio, random)
        picture = 255.0 * front[..., :3] + (1.0 - front[..., 3:]) * behind
        if not studio.is_on_paper and random.random() < OCCLUDED:
            _occlude(picture, studio, random)
        pictures[row] = in_light(picture, studio.is_on_paper, random)
    return pictures


def _background(studio: Studio, random: np.random.Generator) -> Float[np.ndarray, "h w 3"]:
    """One of the backgrounds, mirrored and magnified by up to a half at random."""
    behind = np.asarray(studio.backgrounds[random.integers(len(studio.backgrounds))], np.float32)
    if studio.is_on_paper:
        return behind
    if random.random() < 0.5:
        behind = behind[:, ::-1]
    zoom = random.uniform(1.0, 1.5)
    slack = (1.0 - 1.0 / zoom) * np.array(studio.size)
    corner = slack * random.random(2)
    source_from_picture = np.array([[1 / zoom, 0.0, corner[0]], [0.0, 1 / zoom, corner[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(
            np.ascontiguousarray(behind), source_from_picture, studio.size, flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
    )


def _occlude(picture: Float[np.ndarray, "h w 3"], studio: Studio, random: np.random.Generator) -> None:
    """Lay a turned ellipse of one colour or of background over the picture."""
    width, height = studio.size
    centre = (int(random.integers(width)), int(random.integers(height)))
    across, along = (int(side) for side in random.uniform(0.04, 0.16, 2) * max(width, height))
    mask = np.zeros((height, width), np.uint8)
    cv2.ellipse(mask, centre, (across, along), float(random.uniform(0, 180)), 0, 360, (255,), -1)
    if random.random() < 0.6:
        picture[mask > 0] = _background(studio, random)[mask > 0]
    else:
        picture[mask > 0] = random.uniform(0, 255, 3)


def in_light(
    picture: Float[np.ndarray, "h w 3"], is_on_paper: bool, random: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """Change light, colour and sharpness a little, and add noise; paper changes less."""
    strength = 0.4 if is_on_paper else 1.0
    gain = np.exp(strength * (0.08 * random.standard_normal() + 0.04 * random.standard_normal(3)))
    shift = strength * (6.0 * random.standard_normal() + 3.0 * random.standard_normal(3))
    lit = picture * gain + shift
    if random.random() < 0.5:
        lit = np.asarray(cv2.GaussianBlur(lit, (0, 0), float(random.uniform(0.2, 0.8))), lit.dtype)
    noise = random.uniform(0.0, 4.0) * random.standard_normal(lit.shape, np.float32)
    return np.asarray(np.clip(lit + noise + 0.5, 0, 255).astype(np.uint8))
