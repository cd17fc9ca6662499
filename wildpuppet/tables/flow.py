"""The optical-flow baseline: a drawing that is already there, warped to look like the one that is wanted.

Dense inverse search (Kroeger et al. 2016, OpenCV's DIS, medium preset) stands where the paper has PWC-Net. The flow
runs from the wanted drawing to the known one, so every pixel knows where its colour is: no holes. It is given the very
drawing that it is scored on, as every method here is.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.correspond.baselines import flow_of_drawings
from wildpuppet.tables.error import mean_squared_error

Picture = UInt8[np.ndarray, "H W 3"]


def warped_by_flow(known: Picture, wanted: Picture) -> Picture:
    """Warp a known drawing to the wanted one."""
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in (wanted, known)]
    flow = search.calc(grey[0], grey[1], None)  # type: ignore[call-overload]
    height, width = wanted.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    moved = cv2.remap(
        known, x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
        borderValue=(255, 255, 255),
    )  # fmt: skip
    return np.asarray(moved, np.uint8)


def nearest(known: Sequence[Picture], wanted: Picture) -> int:
    """Choose the known drawing whose pixels are nearest to the wanted one's; the first of equals."""
    return int(np.argmin([mean_squared_error(wanted, picture) for picture in known]))


def carried_by_flow(drawings: Sequence[Picture], points: Float[np.ndarray, "A N 2"]) -> Float[np.ndarray, "A A N 2"]:
    """Carry every drawing's points to every drawing by the flow between the two; points that are not finite stay so."""
    carried = np.full((len(drawings), *points.shape), np.nan)
    for index, start in enumerate(points.astype(np.float64)):
        known = np.isfinite(start).all(-1)
        carried[index][:, known] = flow_of_drawings(drawings, index, start[known])
    return carried
