"""What is known at every pixel of a frame, part by part: opacity, how much of it is seen, texture place, motion.

A part's values cover only the window of the picture that its mesh can reach, so that a frame of many small parts costs
little more than one picture.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int32

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.draw import layer_mesh, typical_scale, window_of
from wildpuppet.render.render import render, texture_at
from wildpuppet.render.surface import surface

FAINTEST = 1e-4
"""Opacity from which a pixel belongs to a part; 8-bit art has nothing fainter than 4e-3."""
BORDER = 2


@dataclass(frozen=True, eq=False)
class PartFields:
    """One part in one frame. ``window`` are the picture's rows and columns that the arrays cover.

    ``alpha`` is the part's own opacity, ``seen`` what is left of it behind the parts in front (0..1 both).
    ``is_there`` marks pixels of the part; ``triangle`` (-1 elsewhere) and ``barycentrics`` say which of its points.
    """

    layer: int
    window: tuple[slice, slice]
    alpha: Float32[np.ndarray, "h w"]
    seen: Float32[np.ndarray, "h w"]
    triangle: Int32[np.ndarray, "h w"]
    barycentrics: Float32[np.ndarray, "h w 3"]

    @property
    def is_there(self) -> Bool[np.ndarray, "h w"]:
        """Where the part has any opacity."""
        return self.triangle >= 0

    def mixed(self, values: Float[np.ndarray, "V c"], triangles: np.ndarray) -> Float[np.ndarray, "h w c"]:
        """Interpolate values of vertices; 0 where the part is not."""
        corners = values[triangles[np.maximum(self.triangle, 0)]]
        return np.asarray((corners * self.barycentrics[..., None]).sum(-2) * self.is_there[..., None])


class Surveyor:
    """Finds the fields of an animation's frames."""

    def __init__(self, animation: Animation) -> None:
        self._animation = animation
        self._texture = texture_at(animation.puppet, typical_scale(animation))
        self._meshes = [layer_mesh(animation.puppet, layer) for layer in range(animation.puppet.num_layers)]

    def parts(self, frame: Frame) -> list[PartFields]:
        """Survey the parts that are in the picture, front to back; none where the character is lost."""
        width, height = self._animation.size
        open_share = np.ones((height, width), np.float32)
        found = []
        for layer in frame.order[::-1].tolist() if frame.is_visible else ():
            part = self._part(frame, layer, open_share)
            if part is not None:
                open_share[part.window] *= 1.0 - part.alpha
                found.append(part)
        return found

    def _part(self, frame: Frame, layer: int, open_share: Float32[np.ndarray, "H W"]) -> PartFields | None:
        mine = frame.vertices[self._animation.puppet.layer_of_vertex == layer]
        window = window_of(mine, self._animation.size, BORDER)
        if window is None:
            return None
        rows, columns = window
        shifted = torch.from_numpy((frame.vertices - (columns.start, rows.start))[None].astype(np.float32))
        order = torch.from_numpy(frame.order[None].astype(np.int64))
        size = (columns.stop - columns.start, rows.stop - rows.start)
        with torch.no_grad():
            rgba = render(shifted, self._meshes[layer], self._texture, order, size).rgba[0]
            place = surface(shifted, self._meshes[layer], self._texture, order, size, threshold=FAINTEST)
        alpha = np.clip(rgba[..., 3].numpy(), 0.0, 1.0).astype(np.float32)  # sums of weights round above 1
        own = np.flatnonzero(self._animation.puppet.layer_of_triangle == layer)
        triangle = place.triangle[0].numpy()
        triangle = np.where(triangle >= 0, own[np.maximum(triangle, 0)], -1).astype(np.int32)
        seen = np.asarray(alpha * open_share[window], np.float32)
        return PartFields(layer, window, alpha, seen, triangle, place.barycentrics[0].numpy())


def foremost(parts: list[PartFields], size: tuple[int, int]) -> Int32[np.ndarray, "H W"]:
    """Number, in ``parts``, of the part that is seen most at each pixel; -1 where none is."""
    width, height = size
    best, most = np.full((height, width), -1, np.int32), np.zeros((height, width), np.float32)
    for number, part in enumerate(parts):
        is_more = part.is_there & (part.seen > most[part.window])
        best[part.window][is_more] = number
        most[part.window][is_more] = part.seen[is_more]
    return best


def where_foremost(
    parts: list[PartFields], best: Int32[np.ndarray, "H W"]
) -> Iterator[tuple[PartFields, Bool[np.ndarray, "h w"]]]:
    """Give each part with the pixels of its window at which it is seen most."""
    for number, part in enumerate(parts):
        yield part, best[part.window] == number
