"""START HERE: every value that passes between stages, with shapes and units.

Axes: T frames, L layers (parts), P rigid pieces of them, V vertices of all layers, F triangles, J joints, K bends,
N points, H W rows and columns.
Coordinates are (x, y), x right, y down, in pixels, origin at the image's corner: the centre of the first pixel is
(0.5, 0.5). The frame of reference is part of the name (``vertices_crop``); maps are destination first
(``video_from_crop``: a (2, 3) matrix that takes crop coordinates to video coordinates). Times are integer pts in a
``Fraction`` time base. Images are uint8 RGB or RGBA with straight alpha unless a name says otherwise.
Values are frozen; arrays that come out of the store are read-only.
"""

from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

TrackState = Literal["followed", "bridged", "lost", "found"]
"""followed: the tracker saw it; bridged: interpolated over a short gap; lost: not seen; found: seen after lost."""

FitState = Literal["fitted", "held", "doubtful", "lost"]
"""fitted; held: copied from the frame that shows the same drawing; doubtful: low confidence; lost: no character."""


@dataclass(frozen=True, eq=False)
class Clip:
    """A video file and its frame table; the pixels stay in the file.

    ``size`` is (W, H) after rotation is applied. ``shot_starts`` always begins with 0. ``bad_frames`` lists frames
    that did not decode (they repeat the last good picture).
    """

    path: Path
    digest: str
    size: tuple[int, int]
    pts: Int[np.ndarray, "T"]
    time_base: Fraction
    shot_starts: tuple[int, ...] = (0,)
    bad_frames: tuple[int, ...] = ()

    @property
    def num_frames(self) -> int:
        """Number of frames in the file."""
        return len(self.pts)


@dataclass(frozen=True)
class Target:
    """Which character and which frames: what ``--bbox --at --start --end`` say. ``end`` is not included.

    ``box_video`` is x, y, w, h in video pixels in frame ``at``.
    """

    box_video: tuple[float, float, float, float]
    at: int
    start: int
    end: int


@dataclass(frozen=True, eq=False)
class Track:
    """The character's box in every frame of the range. ``frames`` are frame numbers of the clip, consecutive."""

    frames: Int[np.ndarray, "T"]
    boxes_video: Float[np.ndarray, "T 4"]
    state: tuple[TrackState, ...]
    score: Float[np.ndarray, "T"]
    shot: Int[np.ndarray, "T"]


@runtime_checkable
class Images(Protocol):
    """A stack of T images that is read a slice at a time; a (T, H, W, 4) uint8 array is one.

    RGBA: straight colour (never multiplied by alpha) and, in A, the matte: 255 surely the character, 0 surely not,
    128 unknown.
    """

    def __len__(self) -> int: ...
    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]: ...


@dataclass(frozen=True, eq=False)
class Crops:
    """Windows of one size cut around the character.

    ``video_from_crop`` places each window in its frame. ``rest_scale`` is the crop pixels per canvas pixel that the
    puppet is expected to have (None until a puppet is known: the box's size decides). ``drawing`` numbers the
    distinct drawings: frames with the same number show the same drawing (a held drawing) and only the first is solved.
    ``reference`` is the index into ``frames`` whose box the user gave (``--at``), or None for unordered drawings.
    ``shot`` numbers the shots; ``ordered`` is False for a folder of unordered drawings.
    ``box_crop`` is the character's box (x, y, w, h) in each crop.
    """

    frames: Int[np.ndarray, "T"]
    size: tuple[int, int]
    video_from_crop: Float[np.ndarray, "T 2 3"]
    images: Images
    box_crop: Float[np.ndarray, "T 4"]
    drawing: Int[np.ndarray, "T"]
    shot: Int[np.ndarray, "T"]
    state: tuple[TrackState, ...]
    reference: int | None
    ordered: bool = True


@dataclass(frozen=True, eq=False)
class Part:
    """One cut-out: a name and an RGBA image that covers the canvas (straight alpha)."""

    name: str
    rgba: UInt8[np.ndarray, "H W 4"]


@dataclass(frozen=True)
class JointSpec:
    """A hinge between two parts, by name. ``at`` in canvas pixels; None: the centroid of the parts' overlap."""

    parts: tuple[str, str]
    at: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class CutOut:
    """What a puppet folder holds: parts back to front and hinges, nothing built yet."""

    canvas: tuple[int, int]
    parts: tuple[Part, ...]
    joints: tuple[JointSpec, ...] = ()
    reference: int | None = None


@dataclass(frozen=True, eq=False)
class Puppet:
    """A built puppet at rest: one mesh of L layers, back to front, with hinges and one texture atlas.

    ``vertices`` rest positions in canvas pixels, grouped by layer. ``uv`` are atlas pixels (corner origin), a pure
    translation of ``vertices`` per layer. ``atlas`` is RGBA, straight alpha, colour bled beyond the edge; its alpha
    is 0 along every mesh border. Joint j ties a point of layer ``joint_layers[j, 0]`` to one of ``joint_layers[j, 1]``;
    each point is the barycentric mix ``joint_weights[j, k]`` of the vertices ``joint_vertices[j, k]``.

    Layer ``bend_layers[k]`` (ascending) bends at ``bend_points[k]``, canvas pixels: it is two rigid pieces there.
    ``bend_axes[k]`` points along it and is half as long as it is wide. Pieces are numbered layer by layer.
    """

    names: tuple[str, ...]
    canvas: tuple[int, int]
    vertices: Float[np.ndarray, "V 2"]
    triangles: Int[np.ndarray, "F 3"]
    layer_of_vertex: Int[np.ndarray, "V"]
    uv: Float[np.ndarray, "V 2"]
    atlas: UInt8[np.ndarray, "H W 4"]
    joint_layers: Int[np.ndarray, "J 2"]
    joint_vertices: Int[np.ndarray, "J 2 3"]
    joint_weights: Float[np.ndarray, "J 2 3"]
    reference: int | None = None
    bend_layers: Int[np.ndarray, "K"] = field(default_factory=lambda: np.zeros(0, np.int64))
    bend_points: Float[np.ndarray, "K 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    bend_axes: Float[np.ndarray, "K 2"] = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def num_layers(self) -> int:
        """Number of layers (parts)."""
        return len(self.names)

    @property
    def layer_of_piece(self) -> Int[np.ndarray, "P"]:
        """Layer of each rigid piece: a layer that bends has two, the one that its axis points to last."""
        layers: Int[np.ndarray, "P"] = np.sort(np.r_[np.arange(self.num_layers), self.bend_layers])
        return layers

    @property
    def layer_of_triangle(self) -> Int[np.ndarray, "F"]:
        """Layer of each triangle."""
        layers: Int[np.ndarray, "F"] = self.layer_of_vertex[self.triangles[:, 0]]
        return layers


@dataclass(frozen=True, eq=False)
class Poses:
    """Coarse poses: a similarity per rigid piece and frame, stretched along the piece's axis, as the search found it.

    ``crop_from_canvas[t, p]`` takes piece p's rest position to its place in crop t (``place.pose_vertices`` takes a
    map per layer too). ``cost`` is the whole energy of the pose, ``margin`` how much worse the best different
    hypothesis is (0: undecided). ``order`` lists layers back to front.
    """

    crop_from_canvas: Float[np.ndarray, "T P 2 3"]
    order: Int[np.ndarray, "T L"]
    cost: Float[np.ndarray, "T"]
    margin: Float[np.ndarray, "T"]


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """The N best poses of each frame, best first; frames with fewer repeat their last with infinite cost."""

    crop_from_canvas: Float[np.ndarray, "T N P 2 3"]
    order: Int[np.ndarray, "T N L"]
    cost: Float[np.ndarray, "T N"]


@dataclass(frozen=True, eq=False)
class Keyframe:
    """What a person fixed in frame ``frame`` of the clip: some points of the puppet, or all of its vertices.

    Point n is the mix ``weights[n]`` of the vertices ``corners[n]``, all of one layer, and stands at
    ``points_video[n]``. ``order`` lists layers back to front where it was given. There are no points where
    ``vertices_video`` is given.
    """

    frame: int
    corners: Int[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n 3"]
    points_video: Float[np.ndarray, "n 2"]
    vertices_video: Float[np.ndarray, "V 2"] | None = None
    order: Int[np.ndarray, "L"] | None = None


@dataclass(frozen=True, eq=False)
class Followed:
    """One keyframe's pose in its own frames (``is_fixed``: those of its drawing) and carried to those around it.

    ``frames`` are indices of crops; ``cost`` is comparable with that of hypotheses.
    """

    frames: Int[np.ndarray, "n"]
    crop_from_canvas: Float[np.ndarray, "n P 2 3"]
    order: Int[np.ndarray, "n L"]
    cost: Float[np.ndarray, "n"]
    is_fixed: Bool[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Fit:
    """The puppet in every frame. ``order[t]`` lists layers back to front; ``confidence`` is 0..1 per vertex.

    ``losses[name]`` is (T,), each term before weighting.
    """

    frames: Int[np.ndarray, "T"]
    vertices_crop: Float[np.ndarray, "T V 2"]
    order: Int[np.ndarray, "T L"]
    confidence: Float[np.ndarray, "T V"]
    state: tuple[FitState, ...]
    losses: dict[str, Float[np.ndarray, "T"]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PointTracks:
    """Points carried to every frame, video pixels."""

    frames: Int[np.ndarray, "T"]
    points_video: Float[np.ndarray, "T N 2"]
    visible: Bool[np.ndarray, "T N"]
    confidence: Float[np.ndarray, "T N"]
