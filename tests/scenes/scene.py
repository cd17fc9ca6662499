"""What drawing gives: frames and the truth about them."""

from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np

from tests.scenes.maps import inverse, mapped
from wildpuppet.types import CutOut
from wildpuppet.video.write import SAME_BYTES


@dataclass(frozen=True, eq=False)
class Scene:
    """Frames and the truth about them. Maps and points: pixels, corner origin; boxes are x, y, w, h around the figure.

    ``drawing`` numbers the distinct drawings from 0; ``alpha`` is the figure's coverage, 0..255.
    """

    frames: np.ndarray
    video_from_canvas: np.ndarray
    boxes: np.ndarray
    order: np.ndarray
    cutout: CutOut
    alpha: np.ndarray
    drawing: np.ndarray
    shot_starts: tuple[int, ...]

    def layer(self, name: str) -> int:
        """Index of a part."""
        return [part.name for part in self.cutout.parts].index(name)

    def truth(self, points_canvas: np.ndarray, layer: int) -> np.ndarray:
        """Where canvas points of a part are in every frame: (T, N, 2)."""
        return mapped(self.video_from_canvas[:, layer], np.asarray(points_canvas, dtype=float))

    def visible(self, points_canvas: np.ndarray, layer: int) -> np.ndarray:
        """Whether canvas points of a part are in the picture and behind no other part: (T, N)."""
        points, (height, width) = self.truth(points_canvas, layer), self.frames.shape[1:3]
        seen = ((points >= 0) & (points < (width, height))).all(-1)
        rank = np.argsort(self.order, axis=1)
        for other in range(len(self.cutout.parts)):
            is_above = rank[:, other] > rank[:, layer]
            seen[is_above] &= ~self.shared(points_canvas, layer, other)[is_above]
        return seen

    def shared(self, points_canvas: np.ndarray, layer: int, other: int) -> np.ndarray:
        """Whether canvas points of a part lie where another part's drawing is too, above it or below: (T, N)."""
        points, maps = self.truth(points_canvas, layer), self.video_from_canvas[:, other]
        return np.stack([self._covers(other, mapped(inverse(maps[t]), points[t])) for t in range(len(points))])

    def points_of(self, layer: int, spacing: int = 6) -> np.ndarray:
        """A grid of canvas points on a part, away from its edge: (N, 2)."""
        solid = cv2.erode(self.cutout.parts[layer].rgba[..., 3], np.ones((5, 5), np.uint8)) > 128
        rows, columns = np.nonzero(solid)
        keep = (rows % spacing == 0) & (columns % spacing == 0)
        return np.stack([columns[keep], rows[keep]], -1) + 0.5

    def _covers(self, layer: int, points: np.ndarray) -> np.ndarray:
        alpha = self.cutout.parts[layer].rgba[..., 3]
        columns, rows = np.floor(points).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < alpha.shape[1]) & (rows < alpha.shape[0])
        return inside & (alpha[rows.clip(0, alpha.shape[0] - 1), columns.clip(0, alpha.shape[1] - 1)] > 128)


def write_clip(scene: Scene, path: Path, rate: int = 24, pixel_format: str = "yuv420p") -> Path:
    """Encode the frames with H.264, nearly without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(
            "libx264", rate=rate, options={"crf": "10", "preset": "veryfast", "x264-params": SAME_BYTES}
        )
        stream.height, stream.width = scene.frames.shape[1:3]
        stream.pix_fmt = pixel_format
        for picture in scene.frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return path
