"""A frame as the compositing needs it: the puppet as it was and as it was painted, and which part is seen where."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.draw import typical_scale, window_of
from wildpuppet.paint.texture import Edit
from wildpuppet.render.render import mesh_of, render, texture_at
from wildpuppet.render.surface import surface

BORDER = 12
"""Pixels around the puppet that belong to its window."""
VISIBLE = 1.5 / 255.0
"""A smaller difference between the two renderings is none."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """One frame's window: premultiplied renderings before and after the painting, and the part seen (-1: none).

    ``changed`` marks where the two differ.
    """

    window: tuple[slice, slice]
    before: Float32[np.ndarray, "h w 4"]
    after: Float32[np.ndarray, "h w 4"]
    layer: Int[np.ndarray, "h w"]
    changed: Bool[np.ndarray, "h w"]


class Both:
    """Renders frames with both textures."""

    def __init__(self, animation: Animation, edit: Edit) -> None:
        scale = typical_scale(animation)
        self._animation, self._mesh = animation, mesh_of(animation.puppet)
        self._before, self._after = texture_at(animation.puppet, scale), texture_at(edit.puppet, scale)
        self._size = animation.size

    def draw(self, frame: Frame) -> Drawn | None:
        """Render one frame; None where no character is in the picture."""
        window = window_of(frame.vertices, self._size, BORDER)
        if not frame.is_visible or window is None:
            return None
        rows, columns = window
        size = (columns.stop - columns.start, rows.stop - rows.start)
        vertices = torch.from_numpy((frame.vertices - (columns.start, rows.start))[None].astype(np.float32))
        order = torch.from_numpy(frame.order[None].astype(np.int64))
        with torch.no_grad():
            before, after = (
                np.asarray(render(vertices, self._mesh, texture, order, size).rgba[0].numpy(), np.float32)
                for texture in (self._before, self._after)
            )
            layer = surface(vertices, self._mesh, self._before, order, size).layer[0].numpy()
        return Drawn(window, before, after, layer.astype(np.int64), (np.abs(after - before) > VISIBLE).any(-1))
