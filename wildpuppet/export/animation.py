"""The one value that every writer gets: a puppet in motion, read a frame at a time.

A frame's place is ``video_from_crop[t]`` applied to ``vertices_crop[t]``. Both are kept because they say different
things: while a drawing is held, ``vertices_crop`` repeats exactly and only the window's map follows the camera, so a
format that has a moving node over a mesh keeps a held drawing as one mesh under a stepped key, and loses nothing.
Formats without such a node take ``vertices(t)``, video pixels. The arrays are small (8 MB for 1,000 frames of 1,000
vertices); pictures are never held: they are drawn a frame at a time by ``export/draw.py``.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from wildpuppet.export.timing import Timing, timing_of
from wildpuppet.geometry.affine import apply
from wildpuppet.types import Crops, Fit, FitState, Puppet


class Frame(NamedTuple):
    """Frame ``t`` of the run: ``number`` in the clip, ``seconds`` from the first frame, ``vertices`` in video pixels.

    ``order`` lists layers back to front. ``pose`` numbers the distinct drawings, in order of appearance; frames with
    the same pose have the same ``vertices_crop``. ``is_visible`` is False where the character is lost: the whole
    puppet is hidden then, though its vertices are finite.
    """

    t: int
    number: int
    seconds: Fraction
    vertices: Float[np.ndarray, "V 2"]
    order: Int[np.ndarray, "L"]
    pose: int
    shot: int
    is_visible: bool


@dataclass(frozen=True, eq=False)
class Animation:
    """A puppet in motion over the frames of a run. ``size`` is the video's (W, H), ``name`` the run's."""

    name: str
    size: tuple[int, int]
    puppet: Puppet
    frames: Int[np.ndarray, "T"]
    vertices_crop: Float[np.ndarray, "T V 2"]
    video_from_crop: Float[np.ndarray, "T 2 3"]
    order: Int[np.ndarray, "T L"]
    confidence: Float[np.ndarray, "T V"]
    state: tuple[FitState, ...]
    shot: Int[np.ndarray, "T"]
    timing: Timing
    is_ordered: bool = True
    """False for a folder of unordered drawings, whose times are made up."""

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        """Give frame after frame."""
        for t in range(len(self)):
            yield self[t]

    def __getitem__(self, t: int) -> Frame:
        """Give one frame; raises IndexError beyond the last."""
        t = range(len(self))[t]
        return Frame(
            t,
            int(self.frames[t]),
            self.timing.seconds(t),
            self.vertices(t),
            self.order[t],
            int(self.pose[t]),
            int(self.shot[t]),
            bool(self.is_visible[t]),
        )

    def vertices(self, t: int) -> Float[np.ndarray, "V 2"]:
        """Place one frame's vertices in the video."""
        return apply(self.video_from_crop[t], self.vertices_crop[t].astype(np.float64))

    @cached_property
    def is_visible(self) -> Bool[np.ndarray, "T"]:
        """Whether the character is there, frame by frame."""
        return np.array([state != "lost" for state in self.state], bool)

    @cached_property
    def pose(self) -> Int[np.ndarray, "T"]:
        """Number of each frame's distinct mesh: frames with exactly equal ``vertices_crop`` share one."""
        known: dict[bytes, int] = {}
        rows = (np.ascontiguousarray(row).tobytes() for row in self.vertices_crop)
        return np.array([known.setdefault(row, len(known)) for row in rows], np.int64)

    @cached_property
    def first_of_pose(self) -> Int[np.ndarray, "n"]:
        """Frame ``t`` at which each pose is seen first."""
        return np.unique(self.pose, return_index=True)[1].astype(np.int64)

    @property
    def order_changes(self) -> list[int]:
        """Frames ``t`` at which the order of layers differs from the frame before; 0 is always one."""
        changed = (np.diff(self.order, axis=0) != 0).any(1) if len(self) else np.zeros(0, bool)
        return [0, *(np.flatnonzero(changed) + 1).tolist()]

    @property
    def shot_starts(self) -> list[int]:
        """Frames ``t`` at which a shot begins; 0 is always one."""
        return [0, *(np.flatnonzero(np.diff(self.shot)) + 1).tolist()]


def animation_of(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    size: tuple[int, int],
    times: tuple[Int[np.ndarray, "T"], Fraction] | None,
    name: str = "puppet",
) -> Animation:
    """Put a run's values together. ``times`` are the frames' pts and their time base; drawings have None."""
    return Animation(
        name=name,
        size=size,
        puppet=puppet,
        frames=fit.frames,
        vertices_crop=_finite(fit.vertices_crop),
        video_from_crop=crops.video_from_crop.astype(np.float64),
        order=fit.order,
        confidence=fit.confidence,
        state=fit.state,
        shot=crops.shot,
        timing=timing_of(len(fit.frames), times),
        is_ordered=times is not None,
    )


def _finite(vertices: Float[np.ndarray, "T V 2"]) -> Float[np.ndarray, "T V 2"]:
    """Stand in the frame before for vertices that are no numbers, as a lost frame's may be; files cannot hold them."""
    broken = ~np.isfinite(vertices).all((1, 2))
    if not broken.any():
        return vertices
    kept = np.flatnonzero(~broken)
    if not len(kept):
        return np.zeros_like(vertices)
    return np.asarray(vertices[kept[np.clip(np.searchsorted(kept, np.arange(len(vertices)), "right") - 1, 0, None)]])
