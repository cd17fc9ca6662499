"""Draw a picture through an affine map, or a textured mesh, onto a canvas; straight alpha in and out."""

import cv2
import numpy as np
from jaxtyping import Float, Int

from wildpuppet.geometry.affine import for_opencv
from wildpuppet.puppet.imports.limits import Rgba

Affine = Float[np.ndarray, "2 3"]


def paint_picture(rgba: Rgba, canvas_from_picture: Affine, canvas: tuple[int, int]) -> Rgba:
    """Draw a picture: exactly where the map is a whole shift, else resampled with soft edges."""
    shift = np.round(canvas_from_picture[:, 2])
    if np.allclose(canvas_from_picture, np.column_stack([np.eye(2), shift]), atol=1e-6):
        return _shifted(rgba, (int(shift[0]), int(shift[1])), canvas)
    padded = cv2.copyMakeBorder(_premultiplied(rgba), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0))
    from_padded = canvas_from_picture @ np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
    drawn = cv2.warpAffine(padded, for_opencv(from_padded), canvas, flags=cv2.INTER_LINEAR)
    return _straight(drawn)


def paint_mesh(
    rgba: Rgba,
    vertices: Float[np.ndarray, "V 2"],
    uv: Float[np.ndarray, "V 2"],
    triangles: Int[np.ndarray, "F 3"],
    canvas: tuple[int, int],
) -> Rgba:
    """Draw a textured mesh; ``uv`` are in the picture's pixels. Later triangles lie over earlier ones."""
    width, height = canvas
    source = np.full((height, width, 2), -10.0, np.float32)
    for corners in triangles:
        _look_up(source, vertices[corners], uv[corners])
    # OpenCV's pixel 0 is a pixel's centre, ours is the picture's corner.
    drawn = cv2.remap(
        _premultiplied(rgba), source[..., 0] - 0.5, source[..., 1] - 0.5, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0, 0),
    )  # fmt: skip
    return _straight(drawn)


def _look_up(
    source: Float[np.ndarray, "H W 2"], corners: Float[np.ndarray, "3 2"], uv: Float[np.ndarray, "3 2"]
) -> None:
    """Write for each pixel centre inside a triangle where in the texture it looks."""
    height, width = source.shape[:2]
    (left, top), (right, bottom) = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    x0, x1 = max(int(left), 0), min(int(right), width)
    y0, y1 = max(int(top), 0), min(int(bottom), height)
    sides = np.column_stack([corners[1] - corners[0], corners[2] - corners[0]])
    if x1 <= x0 or y1 <= y0 or abs(np.linalg.det(sides)) < 1e-12:
        return
    x, y = np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5)
    shares = np.linalg.inv(sides) @ (np.stack([x.ravel(), y.ravel()]) - corners[0][:, None])
    inside = ((shares >= -1e-9).all(axis=0) & (shares.sum(axis=0) <= 1.0 + 1e-9)).reshape(x.shape)
    places = uv[0][:, None] + np.column_stack([uv[1] - uv[0], uv[2] - uv[0]]) @ shares
    source[y0:y1, x0:x1][inside] = places.T.reshape(*x.shape, 2)[inside]


def _shifted(rgba: Rgba, shift: tuple[int, int], canvas: tuple[int, int]) -> Rgba:
    from wildpuppet.puppet.imports.result import Layer, on_canvas

    return on_canvas(Layer("", rgba, shift), canvas)


def _premultiplied(rgba: Rgba) -> Float[np.ndarray, "H W 4"]:
    picture = rgba.astype(np.float32)
    picture[..., :3] *= picture[..., 3:] / 255.0
    return picture


def _straight(picture: Float[np.ndarray, "H W 4"]) -> Rgba:
    alpha = picture[..., 3:]
    colour = picture[..., :3] * (255.0 / np.maximum(alpha, 1e-3))
    both = np.concatenate([np.where(alpha > 0.0, colour, 0.0), alpha], axis=2)
    rgba: Rgba = np.clip(np.rint(both), 0, 255).astype(np.uint8)
    return rgba
