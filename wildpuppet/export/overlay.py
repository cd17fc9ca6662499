"""Pictures of a puppet on a frame: its wireframe and joints, and the puppet drawn again.

Everything is drawn where the vertices are in the picture at hand; callers map them there first (corner origin).
"""

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from wildpuppet.export.palette import colour_of
from wildpuppet.render.render import mesh_of, render, texture_at
from wildpuppet.render.texture import border_edges
from wildpuppet.types import Puppet

Picture = UInt8[np.ndarray, "_ _ 3"]
"""RGB of any size: functions here cut, shrink and join pictures."""

SUBPIXEL_BITS = 4
INNER_SHARE = 0.4
"""Opacity of the edges inside a part; its outline is drawn in full over a dark line."""
BEHIND_SHARE = 0.35
"""Brightness of the source behind the puppet that is drawn again."""


class Overlay:
    """Draws one puppet; ``scale`` is the picture's pixels per canvas pixel, which chooses the texture's level."""

    def __init__(self, puppet: Puppet, scale: float) -> None:
        self._puppet = puppet
        self._mesh = mesh_of(puppet)
        self._texture = texture_at(puppet, scale)
        layers = puppet.layer_of_triangle
        every = [puppet.triangles[layers == layer] for layer in range(puppet.num_layers)]
        self._outlines = [border_edges(triangles) for triangles in every]
        self._edges = [_edges(triangles) for triangles in every]

    def wireframe(self, picture: Picture, vertices: Float[np.ndarray, "V 2"], order: Int[np.ndarray, "L"]) -> Picture:
        """Draw every part's triangles in its colour, back to front, then the joints, over a copy of the picture."""
        lines = picture.copy()
        for layer in order:
            _draw_segments(lines, vertices[self._edges[layer]], colour_of(int(layer)))
        drawn = cv2.addWeighted(picture, 1.0 - INNER_SHARE, lines, INNER_SHARE, 0.0)
        for layer in order:
            outline = vertices[self._outlines[layer]]
            _draw_segments(drawn, outline, (20, 20, 20), 2)
            _draw_segments(drawn, outline, colour_of(int(layer)))
        self._draw_joints(drawn, vertices)
        return np.asarray(drawn)

    def redrawn(self, picture: Picture, vertices: Float[np.ndarray, "V 2"], order: Int[np.ndarray, "L"]) -> Picture:
        """Draw the textured puppet over the dimmed picture."""
        height, width = picture.shape[:2]
        with torch.no_grad():
            image = render(
                torch.from_numpy(vertices[None].astype(np.float32)),
                self._mesh,
                self._texture,
                torch.from_numpy(order[None].astype(np.int64)),
                (width, height),
            )
        rgba = image.rgba[0].numpy()
        mixed = rgba[..., :3] * 255.0 + (1.0 - rgba[..., 3:]) * dimmed(picture)
        return np.asarray(np.clip(np.rint(mixed), 0, 255), np.uint8)

    def _draw_joints(self, picture: Picture, vertices: Float[np.ndarray, "V 2"]) -> None:
        """Draw each hinge as a white dot, and its two points joined by a line where they have come apart."""
        pairs = np.einsum("jkcd,jkc->jkd", vertices[self._puppet.joint_vertices], self._puppet.joint_weights)
        _draw_segments(picture, pairs, (255, 0, 255), 2)
        for centre in _fixed(pairs.mean(1)):
            for radius, colour in ((3.5, (20, 20, 20)), (2.2, (255, 255, 255))):
                cv2.circle(
                    picture, centre.tolist(), int(radius * 2**SUBPIXEL_BITS), colour, -1, cv2.LINE_AA, SUBPIXEL_BITS
                )


def dimmed(picture: Picture) -> Picture:
    """Make a dark grey copy, against which the puppet's colours stand out."""
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    return np.repeat((grey * BEHIND_SHARE + 20).astype(np.uint8)[..., None], 3, axis=2)


def _edges(triangles: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "E 2"]:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0)


def _fixed(points: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n 2"]:
    """OpenCV's fixed-point coordinates of corner-origin points, kept near the picture."""
    near = np.clip(np.rint((points - 0.5) * 2**SUBPIXEL_BITS), -(2**19), 2**19)
    return np.asarray(near, np.int32)


def _draw_segments(
    picture: Picture, segments: Float[np.ndarray, "E 2 2"], colour: tuple[int, int, int], thickness: int = 1
) -> None:
    lines = list(_fixed(segments))
    cv2.polylines(picture, lines, False, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)
