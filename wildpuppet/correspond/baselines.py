"""What correspondence is worth without a puppet: the two rows that stand beside ours in every table.

``copy`` leaves every point where the reference has it. ``dense_flow`` moves it by dense inverse search (Kroeger et
al. 2016, OpenCV's DIS, medium preset, grey images). Frames of a clip are chained one to the next outwards from the
reference, since neighbours look alike; drawings jump, so each is reached from the reference directly.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import chain, islice, pairwise

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Frame = UInt8[np.ndarray, "H W 3"]
Grey = UInt8[np.ndarray, "H W"]
Mover = Callable[[Grey, Grey, Float[np.ndarray, "N 2"]], Float[np.ndarray, "N 2"]]


def copy(points: Float[np.ndarray, "N 2"], num_frames: int) -> Float[np.ndarray, "T N 2"]:
    """Leave the points where they are."""
    return np.repeat(points[None].astype(np.float64), num_frames, 0)


def flow_of_drawings(
    drawings: Sequence[Frame], reference: int, points: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "T N 2"]:
    """Move the points from the reference to each drawing by one flow."""
    move = _mover()
    start = _grey(drawings[reference])
    carried = [move(start, _grey(drawing), points) for drawing in drawings]
    carried[reference] = points.astype(np.float64)
    return np.stack(carried)


def flow_of_clip(
    frames: Iterable[Frame], reference: int, points: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "T N 2"]:
    """Move the points from frame to frame, outwards from the reference.

    Frames up to the reference are held (grey) and walked backwards; those after it are streamed.
    """
    images = (_grey(frame) for frame in frames)
    before = list(islice(images, reference + 1))
    if len(before) <= reference:
        raise ValueError(f"expected more than {reference} frames, found {len(before)}")
    earlier = _chain(reversed(before), points)
    later = _chain(chain(before[-1:], images), points)
    return np.stack(earlier[:0:-1] + later)


def _chain(images: Iterable[Grey], points: Float[np.ndarray, "N 2"]) -> list[Float[np.ndarray, "N 2"]]:
    """Carry points of the first image through all of them, neighbour to neighbour."""
    move = _mover()
    carried = [points.astype(np.float64)]
    for source, target in pairwise(images):
        carried.append(move(source, target, carried[-1]))
    return carried


def _mover() -> Mover:
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def move(source: Grey, target: Grey, points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
        flow = search.calc(source, target, None)  # type: ignore[call-overload]
        return np.asarray(points + sampled(flow, points))

    return move


def sampled(flow: Float[np.ndarray, "H W 2"], points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
    """Read a map bilinearly at corner-origin positions; beyond the image the border's values."""
    height, width = flow.shape[:2]
    centred = np.clip(points - 0.5, 0.0, [width - 1.0, height - 1.0])
    low = np.minimum(centred.astype(np.int64), [max(width - 2, 0), max(height - 2, 0)])
    share = centred - low
    (left, top), (right, under) = low.T, np.minimum(low + 1, [width - 1, height - 1]).T
    x, y = share[:, :1], share[:, 1:]
    upper = flow[top, left] * (1.0 - x) + flow[top, right] * x
    lower = flow[under, left] * (1.0 - x) + flow[under, right] * x
    return np.asarray(upper * (1.0 - y) + lower * y, np.float64)


def _grey(image: Frame) -> Grey:
    grey: Grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return grey
