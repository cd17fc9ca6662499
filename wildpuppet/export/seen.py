"""What shows in each pixel of a frame: for labels, masks and flow."""

import numpy as np
import torch
from jaxtyping import Float, Int

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.draw import typical_scale
from wildpuppet.render.render import mesh_of, texture_at
from wildpuppet.render.surface import surface


class Seen:
    """Finds the layer, the triangle and the mix of its corners at every pixel's centre."""

    def __init__(self, animation: Animation) -> None:
        self._animation = animation
        self._mesh = mesh_of(animation.puppet)
        self._texture = texture_at(animation.puppet, typical_scale(animation))

    def at(self, frame: Frame) -> tuple[Int[np.ndarray, "H W"], Int[np.ndarray, "H W"], Float[np.ndarray, "H W 3"]]:
        """Give layer and triangle (-1 where nothing is) and the mix; nothing is seen of a lost character."""
        width, height = self._animation.size
        if not frame.is_visible:
            nothing = np.full((height, width), -1, np.int32)
            return nothing, nothing, np.zeros((height, width, 3), np.float32)
        found = surface(
            torch.from_numpy(frame.vertices[None].astype(np.float32)),
            self._mesh,
            self._texture,
            torch.from_numpy(frame.order[None].astype(np.int64)),
            self._animation.size,
        )
        return found.layer[0].numpy(), found.triangle[0].numpy(), found.barycentrics[0].numpy()
