"""The preview's frames: the source with wireframe and joints, beside the puppet drawn again over the dimmed source."""

from collections.abc import Iterable, Iterator

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.export.lettering import write_text
from wildpuppet.export.meshes import vertices_video
from wildpuppet.export.overlay import Overlay, Picture, dimmed
from wildpuppet.export.palette import STATE_COLOURS
from wildpuppet.types import Crops, Fit, Puppet

MOST_WIDTH = 1920
CAPTION_ROWS = 24


def preview_frames(
    sources: Iterable[Picture], puppet: Puppet, crops: Crops, fit: Fit, most_width: int = MOST_WIDTH
) -> Iterator[Picture]:
    """Yield one picture per frame of the fit: wireframe left, puppet right, a caption under them.

    ``sources`` are the clip's frames in the order of ``fit.frames``, streamed. Pictures are at the source's resolution
    unless two of them are wider than ``most_width``; width and height are even, as encoders want. Raises ValueError
    when there are fewer sources than frames.
    """
    placed = vertices_video(crops, fit)
    overlay, shrink = None, 1.0
    number = 0
    for number, (source, vertices) in enumerate(zip(sources, placed, strict=False), 1):
        if overlay is None:
            shrink = min(1.0, most_width / (2.0 * source.shape[1]))
            overlay = Overlay(puppet, shrink * typical_scale(puppet, placed, fit))
        picture = _resized(source, shrink)
        shape = np.array(picture.shape[1::-1]) / np.array(source.shape[1::-1])
        yield _frame(picture, vertices * shape, fit, number - 1, overlay)
    if number < len(placed):
        raise ValueError(f"expected {len(placed)} source frames, found {number}")


def typical_scale(puppet: Puppet, vertices: Float[np.ndarray, "T V 2"], fit: Fit) -> float:
    """Video pixels per canvas pixel: the middle over frames that have the character, by the mesh's area."""
    kept = [index for index, state in enumerate(fit.state) if state != "lost"]
    rest = _area(puppet.vertices[None], puppet.triangles)[0]
    if not kept or rest <= 0.0:
        return 1.0
    return max(float(np.sqrt(np.median(_area(vertices[kept], puppet.triangles)) / rest)), 1e-3)


def caption(fit: Fit, index: int) -> str:
    """Say in a few words how frame ``index`` of the fit went."""
    words = f"frame {int(fit.frames[index])}   {fit.state[index]}   confidence {fit.confidence[index].mean():.2f}"
    name = loss_name(fit)
    return words if name is None else f"{words}   {name} {fit.losses[name][index]:.4g}"


def loss_name(fit: Fit) -> str | None:
    """Name of the loss to show: the total, else the reconstruction, else the first there is."""
    return next((name for name in ("total", "reconstruction", *fit.losses) if name in fit.losses), None)


def _frame(picture: Picture, vertices: Float[np.ndarray, "V 2"], fit: Fit, index: int, overlay: Overlay) -> Picture:
    if fit.state[index] == "lost":
        left, right = picture, dimmed(picture)
    else:
        left = overlay.wireframe(picture, vertices, fit.order[index])
        right = overlay.redrawn(picture, vertices, fit.order[index])
    strip = np.full((CAPTION_ROWS, 2 * picture.shape[1], 3), 28, np.uint8)
    strip[6:18, 6:18] = STATE_COLOURS[fit.state[index]]
    write_text(strip, (26, 3), caption(fit, index))
    return np.concatenate([np.concatenate([left, right], 1), strip])


def _resized(source: Picture, shrink: float) -> UInt8[np.ndarray, "h w 3"]:
    """Shrink to even sides; a side that is odd loses or gains less than a pixel."""
    width, height = (max(2, 2 * round(side * shrink / 2)) for side in source.shape[1::-1])
    if (height, width) == source.shape[:2]:
        return source
    return np.asarray(cv2.resize(source, (width, height), interpolation=cv2.INTER_AREA))


def _area(vertices: Float[np.ndarray, "T V 2"], triangles: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, "T"]:
    a, b, c = (vertices[:, triangles[:, k]] for k in range(3))
    first, second = b - a, c - a
    return np.asarray(np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]).sum(1) / 2.0)
