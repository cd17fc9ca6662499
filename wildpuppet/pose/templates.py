"""Part templates for the search: each layer's picture, turned and scaled, as lists of coloured pixels.

Cartoons are made of few colours. The puppet's colours are gathered into a small palette; for each palette colour the
frame is turned once into a map "how badly does this pixel disagree with that colour" (robust, so a wrong pixel costs
no more than 1), and a template's cost is the sum of such maps over its pixels. This keeps a robust cost exact where
correlation by Fourier transform would need a squared one.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int

from wildpuppet.puppet.atlas import layer_picture
from wildpuppet.puppet.colour import lab
from wildpuppet.types import Puppet


@dataclass(frozen=True, eq=False)
class PartImage:
    """One layer's picture: premultiplied RGBA 0..1, and the canvas position of its corner and its pivot."""

    premultiplied: Float[np.ndarray, "h w 4"]
    corner: Float[np.ndarray, "2"]
    pivot: Float[np.ndarray, "2"]


@dataclass(frozen=True, eq=False)
class Templates:
    """Pixels of all templates of one scale, flat.

    ``start[l, k]`` .. ``start[l, k] + count[l, k]`` index the pixels of layer l turned by ``radians[k]``. A pixel is
    (dy, dx) from the pivot's pixel, a palette index and a weight; each layer's weights sum to its ``area`` in search
    pixels.
    """

    scale: float
    radians: Float[np.ndarray, "K"]
    start: Int[np.ndarray, "L K"]
    count: Int[np.ndarray, "L K"]
    pixels: Int[np.ndarray, "P 3"]
    weights: Float[np.ndarray, "P"]
    area: Float[np.ndarray, "L"]
    reach: int


def part_images(puppet: Puppet) -> tuple[PartImage, ...]:
    """Cut each layer's picture out of the atlas; the pivot is its centre of opaque mass."""
    images = []
    for layer in range(puppet.num_layers):
        drawn, corner = layer_picture(puppet, layer)
        patch = drawn.astype(np.float32) / 255
        patch[..., :3] *= patch[..., 3:]
        mass = patch[..., 3] + 1e-6
        rows, columns = np.indices(mass.shape) + 0.5
        pivot = corner + np.array([(columns * mass).sum(), (rows * mass).sum()]) / mass.sum()
        images.append(PartImage(patch, corner, pivot))
    return tuple(images)


def mean_colours(images: tuple[PartImage, ...]) -> Float[np.ndarray, "L 3"]:
    """Give each part's mean colour in Lab."""
    sums = np.stack([image.premultiplied.reshape(-1, 4).sum(0) for image in images])
    colours = (sums[:, :3] / np.maximum(sums[:, 3:], 1e-6)).clip(0, 1)
    mean: Float[np.ndarray, "L 3"] = lab(colours[None].astype(np.float32))[0]
    return mean


def palette_of(images: tuple[PartImage, ...], scale: float, num_colours: int) -> Float[np.ndarray, "C 3"]:
    """Cluster the parts' colours, as seen at ``scale``, in Lab."""
    samples = []
    for image in images:
        size = tuple(max(1, round(side * scale)) for side in image.premultiplied.shape[1::-1])
        small = cv2.resize(image.premultiplied, size, interpolation=cv2.INTER_AREA)
        opaque = small[..., 3] > 0.5
        if opaque.any():
            colour = (small[..., :3] / small[..., 3:].clip(0.5)).clip(0, 1)
            samples.append(lab(colour)[opaque])
    points = np.concatenate(samples) if samples else np.zeros((1, 3), np.float32)
    if len(points) == 1:  # OpenCV would take a single row for three points of one number
        return points
    num_colours = min(num_colours, len(np.unique(points.round(1), axis=0)))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.2)
    cv2.setRNGSeed(0)
    labels = np.zeros((len(points), 1), np.int32)  # written, not read: no first guess is used
    _, _, centres = cv2.kmeans(points.astype(np.float32), num_colours, labels, stop, 2, cv2.KMEANS_PP_CENTERS)
    return np.asarray(centres, np.float32)


UNCHANGED = np.eye(2)


def make_templates(
    images: tuple[PartImage, ...],
    scale: float,
    num_angles: int,
    palette: Float[np.ndarray, "C 3"],
    most_pixels: int = 100,
    shape: Float[np.ndarray, "2 2"] = UNCHANGED,
) -> Templates:
    """Turn and scale every part. ``scale`` is search pixels per canvas pixel.

    Parts of more than ``most_pixels`` pixels are sampled evenly, their weights raised to keep the area. ``shape`` is
    what is done to the parts about their pivots first.
    """
    radians = np.arange(num_angles) * (2 * np.pi / num_angles)
    lists, weights, counts, areas, reach = [], [], [], [], 1
    for image in images:
        layer_areas = []
        for angle in radians:
            pixels, weight = _template(image, scale, float(angle), palette, shape)
            reach = max(reach, int(np.abs(pixels[:, :2]).max()) + 1)
            layer_areas.append(weight.sum())
            step = max(1, int(np.ceil(len(pixels) / most_pixels)))
            kept = pixels[step // 2 :: step]
            kept_weight = weight[step // 2 :: step]
            lists.append(kept)
            weights.append(kept_weight * (weight.sum() / max(float(kept_weight.sum()), 1e-6)))
            counts.append(len(kept))
        areas.append(float(np.mean(layer_areas)))
    count = np.array(counts).reshape(len(images), num_angles)
    start = (np.cumsum(counts) - counts).reshape(count.shape)
    return Templates(
        scale,
        radians,
        start,
        count,
        np.concatenate(lists).astype(np.int32),
        np.concatenate(weights).astype(np.float32),
        np.array(areas, np.float32),
        reach,
    )


def _template(
    image: PartImage, scale: float, radians: float, palette: Float[np.ndarray, "C 3"], shape: Float[np.ndarray, "2 2"]
) -> tuple[Int[np.ndarray, "P 3"], Float[np.ndarray, "P"]]:
    picture = image.premultiplied
    shrink = max(1.0, 1.0 / max(scale, 1e-3))
    if shrink > 1.5:  # the warp samples points: average first, so that it sees every pixel
        picture = cv2.GaussianBlur(picture, (0, 0), 0.4 * shrink)
    pivot = image.pivot - image.corner
    radius = int(np.ceil(np.hypot(*picture.shape[:2]) * scale * np.linalg.norm(shape, 2))) + 1
    cos, sin = scale * np.cos(radians), scale * np.sin(radians)
    linear = np.array([[cos, -sin], [sin, cos]]) @ shape
    centre = np.array([radius + 0.5, radius + 0.5])
    offset = centre - linear @ pivot
    half = np.array([0.5, 0.5])
    warp = np.concatenate([linear, (offset + linear @ half - half)[:, None]], 1)
    side = 2 * radius + 1
    turned = cv2.warpAffine(picture, warp, (side, side), flags=cv2.INTER_LINEAR)
    alpha = turned[..., 3]
    rows, columns = np.nonzero(alpha > 0.35)
    if not len(rows):
        rows, columns = np.array([radius]), np.array([radius])
    colour = (turned[rows, columns, :3] / alpha[rows, columns, None].clip(0.05)).clip(0, 1)
    distance = ((lab(colour[None])[0][:, None] - palette[None]) ** 2).sum(-1)
    pixels = np.stack([rows - radius, columns - radius, distance.argmin(1)], 1)
    return pixels, alpha[rows, columns].astype(np.float32)
