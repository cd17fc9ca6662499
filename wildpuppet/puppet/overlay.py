"""A picture to judge a puppet by: the parts as they are drawn, their outlines, names, meshes and joints."""

import colorsys

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.geometry.affine import for_opencv, scale_and_shift
from wildpuppet.geometry.topology import unique_edges
from wildpuppet.types import CutOut, Puppet

PANEL_PIXELS = 900
"""Larger side of each of the two panels."""
SURROUND = 0.06
"""Canvas shown around the puppet, as a share of its larger side."""
PAPER = (225, 225, 225)

Rgb = UInt8[np.ndarray, "H W 3"]


def overlay(cutout: CutOut, puppet: Puppet) -> Rgb:
    """Draw two panels: parts with outlines, names and numbered joints; and the meshes over the dimmed parts."""
    low, high = puppet.vertices.min(axis=0), puppet.vertices.max(axis=0)
    side = float((high - low).max())
    low, high = low - SURROUND * side, high + SURROUND * side
    scale = PANEL_PIXELS / float((high - low).max())
    picture = _composite(cutout, low, high, scale)
    left, right = picture.copy(), (0.5 * picture + 127.0).astype(np.uint8)
    colors = part_colors(puppet.num_layers)
    for layer in range(puppet.num_layers):
        alpha = _seen(cutout.parts[layer].rgba[..., 3].astype(np.float32), low, high, scale)
        outlines, _ = cv2.findContours((alpha > 127).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(left, outlines, -1, colors[layer], 2, cv2.LINE_AA)
        edges = unique_edges(puppet.triangles[puppet.layer_of_triangle == layer])
        _draw_edges(right, (puppet.vertices - low) * scale, edges, colors[layer])
    for layer, name in enumerate(puppet.names):
        middle = puppet.vertices[puppet.layer_of_vertex == layer].mean(axis=0)
        _draw_text(left, name, (middle - low) * scale, colors[layer])
    places = np.einsum("jkc,jkcx->jkx", puppet.joint_weights, puppet.vertices[puppet.joint_vertices]).mean(axis=1)
    for index, place in enumerate((places - low) * scale):
        _draw_joint(left, str(index), place)
        _draw_joint(right, str(index), place)
    return np.concatenate([left, right], axis=1)


def part_colors(count: int) -> list[tuple[int, int, int]]:
    """Choose RGB colours that differ between neighbours in the order."""
    shades = [colorsys.hsv_to_rgb((0.61803 * index) % 1.0, 1.0, 0.85 - 0.3 * (index % 2)) for index in range(count)]
    return [(int(255 * r), int(255 * g), int(255 * b)) for r, g, b in shades]


def _composite(cutout: CutOut, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"], scale: float) -> Rgb:
    width, height = (round(side) for side in (high - low) * scale)
    picture = np.full((height, width, 3), PAPER, np.float32)
    for part in cutout.parts:
        straight = part.rgba.astype(np.float32)
        alpha = straight[..., 3:] / 255.0
        layer = np.concatenate([straight[..., :3] * alpha, alpha], axis=2)
        seen = _seen(layer, low, high, scale)
        picture = seen[..., :3] + (1.0 - seen[..., 3:]) * picture
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def _seen(
    image: Float[np.ndarray, "H W *c"], low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"], scale: float
) -> Float[np.ndarray, "h w *c"]:
    """Resample the canvas window from ``low`` to ``high``."""
    width, height = (round(side) for side in (high - low) * scale)
    canvas_from_panel = for_opencv(scale_and_shift(1.0 / scale, (float(low[0]), float(low[1]))))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen: Float[np.ndarray, "h w *c"] = cv2.warpAffine(image, canvas_from_panel, (width, height), flags=flags)
    return seen


def _pixel(point: Float[np.ndarray, "2"]) -> tuple[int, int]:
    """Give a corner-origin point as OpenCV's fixed-point pixel centre coordinates (four fractional bits)."""
    return round(float(point[0] - 0.5) * 16), round(float(point[1] - 0.5) * 16)


def _draw_edges(
    picture: Rgb,
    points: Float[np.ndarray, "V 2"],
    edges: Int[np.ndarray, "E 2"],
    color: tuple[int, int, int],
) -> None:
    for a, b in edges:
        cv2.line(picture, _pixel(points[a]), _pixel(points[b]), color, 1, cv2.LINE_AA, shift=4)


def _draw_text(picture: Rgb, text: str, middle: Float[np.ndarray, "2"], color: tuple[int, int, int]) -> None:
    shown = text.encode("ascii", "replace").decode("ascii")
    (width, height), _ = cv2.getTextSize(shown, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
    x = int(np.clip(middle[0] - width / 2, 2, max(2, picture.shape[1] - width - 2)))
    corner = (x, int(middle[1] + height / 2))
    cv2.putText(picture, shown, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 4, cv2.LINE_AA)
    cv2.putText(picture, shown, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.45, color, 1, cv2.LINE_AA)


def _draw_joint(picture: Rgb, label: str, place: Float[np.ndarray, "2"]) -> None:
    cv2.circle(picture, _pixel(place), 6 * 16, (255, 255, 255), -1, cv2.LINE_AA, shift=4)
    cv2.circle(picture, _pixel(place), 5 * 16, (0, 0, 0), -1, cv2.LINE_AA, shift=4)
    _draw_text(picture, label, place + np.array([0.0, -13.0]), (0, 0, 0))
