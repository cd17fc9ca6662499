"""Colours as they are compared: CIE Lab, in which equal distances look about equal."""

import cv2
import numpy as np
from jaxtyping import Float


def lab(rgb: Float[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W 3"]:
    """Turn RGB 0..1 (float32) into CIE Lab (L 0..100)."""
    converted: Float[np.ndarray, "H W 3"] = cv2.cvtColor(np.ascontiguousarray(rgb, np.float32), cv2.COLOR_RGB2Lab)
    return converted
