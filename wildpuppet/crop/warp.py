"""Cutting a window out of a picture: one warp that is right to sub-pixels and does not alias when it shrinks."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.geometry import affine


def cut_window(
    image: UInt8[np.ndarray, "H W *channels"],
    image_from_crop: Float[np.ndarray, "2 3"],
    size: tuple[int, int],
    interpolation: int = cv2.INTER_LINEAR,
) -> UInt8[np.ndarray, "h w *channels"]:
    """Resample ``image`` on the crop's grid; pixels beyond the image repeat its edge.

    Where the crop is coarser than the image by more than 1.2, the image is blurred first, with the Gaussian that a
    box of one crop pixel amounts to.
    """
    shrink = float(np.sqrt(abs(np.linalg.det(image_from_crop[:, :2]))))
    region, region_from_crop = needed_region(image, image_from_crop, size)
    if shrink > 1.2:
        deviation = 0.5 * float(np.sqrt(shrink**2 - 1.0))
        region = cv2.GaussianBlur(region, (0, 0), deviation, borderType=cv2.BORDER_REPLICATE)
    flags = interpolation | cv2.WARP_INVERSE_MAP
    warped: np.ndarray = cv2.warpAffine(
        region, affine.for_opencv(region_from_crop), size, flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    return warped


def needed_region(
    image: UInt8[np.ndarray, "H W *channels"], image_from_crop: Float[np.ndarray, "2 3"], size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "h w *channels"], Float[np.ndarray, "2 3"]]:
    """Restrict the image to what the window needs, with a border for the blur, and the map to it."""
    corners = affine.apply(image_from_crop, np.array([[0.0, 0.0], [size[0], 0.0], [0.0, size[1]], [size[0], size[1]]]))
    border = 8 + 4 * float(np.abs(image_from_crop[:, :2]).max())
    height, width = image.shape[:2]
    low = np.clip(np.floor(corners.min(0) - border), 0, [width - 1, height - 1]).astype(np.int64)
    high = np.clip(np.ceil(corners.max(0) + border), low + 1, [width, height]).astype(np.int64)
    shifted = image_from_crop.astype(np.float64).copy()
    shifted[:, 2] -= low
    return image[low[1] : high[1], low[0] : high[0]], shifted


def inside_image(
    image_size: tuple[int, int], image_from_crop: Float[np.ndarray, "2 3"], size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """Mark the crop pixels whose centres lie inside the image; the map must be pure scale and shift."""
    if image_from_crop[0, 1] != 0.0 or image_from_crop[1, 0] != 0.0:
        raise ValueError("inside_image: expected a map without a turn")
    x = image_from_crop[0, 0] * (np.arange(size[0]) + 0.5) + image_from_crop[0, 2]
    y = image_from_crop[1, 1] * (np.arange(size[1]) + 0.5) + image_from_crop[1, 2]
    inside: np.ndarray = ((y >= 0) & (y < image_size[1]))[:, None] & ((x >= 0) & (x < image_size[0]))
    return inside
