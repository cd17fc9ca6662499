"""How far each vertex can be trusted, from what the picture says around it.

A vertex is trusted where the puppet's picture agrees with the frame's around it, less where it is hidden (then it only
follows its neighbours).
"""

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from wildpuppet.fit.descent import Problem
from wildpuppet.fit.target import WHITE
from wildpuppet.render.render import render
from wildpuppet.render.surface import surface

AGREES = 25.0
"""Grey levels of difference at which half the trust is gone."""
HIDDEN = 0.5
"""Trust that is left where another layer covers the vertex."""


def confidence_of(problem: Problem, vertices: Float[Tensor, "B V 2"]) -> Float[np.ndarray, "B V"]:
    """Compute 0..1 per vertex; ``vertices`` in level pixels."""
    width, height = problem.size
    with torch.no_grad():
        image = render(vertices, problem.mesh, problem.texture, problem.order, problem.size).rgba
        alpha = image[..., 3:]
        difference = (problem.target.colour * alpha - WHITE * image[..., :3]).norm(dim=-1) / np.sqrt(3)
        seen = surface(vertices, problem.mesh, problem.texture, problem.order, problem.size)
    spread = 0.03 * max(problem.size)
    result = np.zeros(vertices.shape[:2])
    for b in range(len(vertices)):
        mask = alpha[b, ..., 0].numpy()
        weight = cv2.GaussianBlur(mask, (0, 0), spread) + 1e-3
        local = cv2.GaussianBlur(difference[b].numpy(), (0, 0), spread) / weight
        columns = vertices[b, :, 0].numpy().astype(int).clip(0, width - 1)
        rows = vertices[b, :, 1].numpy().astype(int).clip(0, height - 1)
        layer = seen.layer[b].numpy()[rows, columns]
        hidden = (layer != problem.puppet.layer_of_vertex) & (layer >= 0)
        trust = 1 / (1 + (local[rows, columns] / AGREES) ** 2)
        result[b] = trust * np.where(hidden, HIDDEN, 1.0)
    return result
