"""Clips drawn by OpenCV with exact truth: a cut-out figure posed by forward kinematics over a painted background.

    scene = make_scene("walk", frames=24, size=(320, 240), seed=0)

Kinds: walk (legs and arms cross), crossing (both arms sweep over the body), hidden (the left arm goes fully behind
the torso), order (the right arm goes from the front to the back of the torso), pan and zoom (a moving camera), cut
(a second shot on another background), twos (each drawing is held for two frames). ``hold``, ``camera`` and
``cut_at`` combine with any kind.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import av
import cv2
import numpy as np

from tests.figure import CANVAS, FINE, LIMBS, NAMES, draw_figure, smooth_noise
from wildpuppet.types import CutOut

Kind = Literal["walk", "crossing", "hidden", "order", "pan", "zoom", "cut", "twos"]
Camera = Literal["still", "pan", "zoom"]
Angles = dict[str, float]

FIGURE_HEIGHT = 200.0
"""Canvas pixels from hair to soles."""


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
        return NAMES.index(name)

    def truth(self, points_canvas: np.ndarray, layer: int) -> np.ndarray:
        """Where canvas points of a part are in every frame: (T, N, 2)."""
        return _mapped(self.video_from_canvas[:, layer], np.asarray(points_canvas, dtype=float))

    def visible(self, points_canvas: np.ndarray, layer: int) -> np.ndarray:
        """Whether canvas points of a part are in the picture and behind no other part: (T, N)."""
        points, (height, width) = self.truth(points_canvas, layer), self.frames.shape[1:3]
        seen = ((points >= 0) & (points < (width, height))).all(-1)
        for frame, order in enumerate(self.order):
            for above in order[list(order).index(layer) + 1 :]:
                back = _mapped(_inverse(self.video_from_canvas[frame, above]), points[frame])
                seen[frame] &= ~self._covers(above, back)
        return seen

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


def make_scene(
    kind: Kind = "walk",
    frames: int = 24,
    size: tuple[int, int] = (320, 240),
    seed: int = 0,
    *,
    hold: int | None = None,
    camera: Camera | None = None,
    cut_at: int | None = None,
    identical: bool = False,
    height: float = 0.68,
    cycles: float = 1.25,
) -> Scene:
    """Draw a scene. ``height`` is the figure's share of the picture's; ``identical`` paints left and right limbs alike.

    ``cycles`` counts strides over the clip (a stride is two steps). A held figure still lets the camera move.
    """
    hold = hold or (2 if kind == "twos" else 1)
    camera = camera or ({"pan": "pan", "zoom": "zoom"}.get(kind, "still"))
    cut_at = cut_at or (frames // 2 if kind == "cut" else None)
    drawing_at = np.arange(frames) // hold * hold
    shares = drawing_at / max(frames - 1, 1)
    shot = np.zeros(frames, int) if cut_at is None else (np.arange(frames) >= cut_at).astype(int)
    scale = height * size[1] / FIGURE_HEIGHT
    world = np.stack([_posed(kind, share, size, scale, camera, cycles) for share in shares])
    if cut_at is not None:
        world[shot == 1] = _after(_about((size[0] / 2, size[1] * 0.95), 0.8, 0.0), world[shot == 1])
    video_from_world = np.stack([_camera(camera, time, size) for time in np.arange(frames) / max(frames - 1, 1)])
    video_from_canvas = _after(video_from_world[:, None], world)
    order = np.stack([_order(kind, share) for share in shares])
    cutout, art = draw_figure(seed, identical)
    grounds = [Background(video_from_world[shot == which], size, [seed, which, 7]) for which in range(shot.max() + 1)]
    pictures = [
        _picture(grounds[shot[t]].through(video_from_world[t]), video_from_canvas[t], order[t], art)
        for t in range(frames)
    ]
    alpha = np.stack([picture[..., 3] for picture in pictures])
    boxes = np.stack([np.array(cv2.boundingRect((a > 128).astype(np.uint8)), dtype=float) for a in alpha])
    starts = (0,) if cut_at is None else (0, cut_at)
    shown = np.stack([picture[..., :3] for picture in pictures])
    numbers = np.unique(np.stack([drawing_at, shot]), axis=1, return_inverse=True)[1].reshape(-1)
    return Scene(shown, video_from_canvas, boxes, order, cutout, alpha, numbers, starts)


def write_clip(scene: Scene, path: Path, rate: int = 24, pixel_format: str = "yuv420p") -> Path:
    """Encode the frames with H.264, nearly without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": "10", "preset": "veryfast"})
        stream.height, stream.width = scene.frames.shape[1:3]
        stream.pix_fmt = pixel_format
        for picture in scene.frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return path


class Background:
    """A painted world, as large as the camera's path needs: sky, hills, blobs and a floor of smooth noise."""

    def __init__(self, video_from_world: np.ndarray, size: tuple[int, int], seed: list[int]) -> None:
        corners = np.array([[0, 0], [size[0], 0], [0, size[1]], [size[0], size[1]]], dtype=float)
        reach = np.concatenate([_mapped(_inverse(camera), corners) for camera in video_from_world])
        self.size, self.corner = size, np.floor(reach.min(0)) - 2
        width, height = (np.ceil(reach.max(0)) + 2 - self.corner).astype(int)
        self.picture = _painting(width, height, size[1] * 0.8 - self.corner[1], np.random.default_rng(seed))

    def through(self, video_from_world: np.ndarray) -> np.ndarray:
        """The view at ``FINE`` times the video's size, float RGB."""
        shifted = _after(video_from_world, np.array([[1.0, 0, self.corner[0]], [0, 1.0, self.corner[1]]]))
        width, height = FINE * self.size[0], FINE * self.size[1]
        return cv2.warpAffine(
            self.picture,
            _opencv(FINE * shifted),
            (width, height),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )


def _painting(width: int, height: int, floor: float, paint: np.random.Generator) -> np.ndarray:
    def tint(low: int, high: int) -> tuple[int, ...]:
        return tuple(int(c) for c in paint.integers(low, high, 3))

    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = tint(150, 225)
    for _ in range(3):
        centre = (int(paint.uniform(0, width)), int(floor + paint.uniform(10, 60)))
        axes = (int(paint.uniform(0.2, 0.5) * width), int(paint.uniform(0.3, 0.6) * height))
        cv2.ellipse(picture, (centre, (2 * axes[0], 2 * axes[1]), 0.0), tint(95, 190), -1, cv2.LINE_AA)
    for _ in range(max(6, width // 45)):
        x, y = paint.uniform(0, width), paint.uniform(0, floor)
        w, h = paint.uniform(6, 22), paint.uniform(10, 50)
        if paint.random() < 0.5:
            cv2.rectangle(picture, (int(x - w), int(y)), (int(x + w), int(floor)), tint(80, 200), -1)
        else:
            cv2.circle(picture, (int(x), int(y)), int(0.6 * h), tint(90, 220), -1, cv2.LINE_AA)
    cv2.rectangle(picture, (0, int(floor)), (width, height), tint(90, 170), -1)
    texture = sum(share * smooth_noise((height, width), cells, paint) for cells, share in ((5, 22), (17, 12), (71, 9)))
    return np.clip(picture + texture[..., None] + 1.5 * paint.standard_normal((height, width, 1)), 0, 255).astype(
        np.float32
    )


def _picture(
    ground: np.ndarray, video_from_canvas: np.ndarray, order: np.ndarray, art: dict[str, np.ndarray]
) -> np.ndarray:
    """Composite the parts back to front at ``FINE`` times the size; RGB and coverage at the video's size."""
    height, width = ground.shape[:2]
    shown = np.concatenate([ground, np.zeros((height, width, 1), np.float32)], -1)
    for layer in order:
        paint, place = art[NAMES[layer]], video_from_canvas[layer].copy()
        place[:, 2] *= FINE  # both art and picture are FINE times larger
        x, y, w, h = _bounds(paint)
        corners = _mapped(place, np.array([[x, y], [x + w, y], [x, y + h], [x + w, y + h]], dtype=float))
        left, top = np.clip(np.floor(corners.min(0)).astype(int), 0, (width, height))
        right, bottom = np.clip(np.ceil(corners.max(0)).astype(int), 0, (width, height))
        if right <= left or bottom <= top:
            continue
        place = _after(np.array([[1.0, 0, -left], [0, 1.0, -top]]), _after(place, np.array([[1.0, 0, x], [0, 1.0, y]])))
        warped = cv2.warpAffine(paint[y : y + h, x : x + w], _opencv(place), (int(right - left), int(bottom - top)))
        under = shown[top:bottom, left:right]
        under *= 1 - warped[..., 3:] / 255
        under += warped
    small = cv2.resize(shown, (width // FINE, height // FINE), interpolation=cv2.INTER_AREA)
    return np.clip(small + 0.5, 0, 255).astype(np.uint8)


def _bounds(paint: np.ndarray) -> tuple[int, int, int, int]:
    x, y, w, h = cv2.boundingRect((paint[..., 3] > 0).astype(np.uint8))
    return x - 1, y - 1, w + 2, h + 2


def _posed(kind: Kind, share: float, size: tuple[int, int], scale: float, camera: Camera, cycles: float) -> np.ndarray:
    """Forward kinematics: world_from_canvas of every part, (L, 2, 3)."""
    phase = 2 * np.pi * cycles * share
    travel = 0.0 if kind in ("crossing", "hidden", "order") else (1.1 if camera == "pan" else 0.3) * (share - 0.5)
    root = (size[0] * (0.5 + travel), size[1] * 0.93 - scale * (82 - 3 * abs(np.cos(phase))))
    angles = _angles(kind, share, phase)
    hinge = {part.name: part.hinge for part in LIMBS}
    parents = {part.name: part.parent for part in LIMBS}
    rests = {part.name: part.rest_radians for part in LIMBS}
    shift = np.array([[scale, 0, root[0] - scale * hinge["torso"][0]], [0, scale, root[1] - scale * hinge["torso"][1]]])

    def place(name: str) -> np.ndarray:
        if name == "torso":
            return _after(shift, _about(hinge["torso"], 1.0, angles["torso"]))
        if name == "head":
            return _after(place("torso"), _about(hinge["head"], 1.0, angles["head"]))
        own = angles[name] - rests[name]
        carried = 0.0 if parents[name] == "torso" else angles[parents[name]] - rests[parents[name]]
        return _after(place(parents[name]), _about(hinge[name], 1.0, carried - own))

    return np.stack([place(name) for name in NAMES])


def _angles(kind: Kind, share: float, phase: float) -> Angles:
    """Torso and head: turns. Limbs: directions from straight down towards +x, relative to the torso."""
    degrees = {"torso": 3 * np.sin(2 * phase), "head": 5 * np.sin(phase + 1)}
    for side, half in (("right", 0.0), ("left", np.pi)):
        swing = np.sin(phase + half)
        thigh = 30 * swing + 4
        knee = 8 + 38 * max(0.0, np.cos(phase + half)) ** 1.5
        degrees |= {f"{side}_thigh": thigh, f"{side}_shin": thigh - knee}
        degrees |= {f"{side}_upper_arm": -34 * swing - 2, f"{side}_forearm": -34 * swing + 24 - 10 * swing}
    if kind in ("crossing", "hidden", "order"):
        degrees |= _gesture(kind, share, phase)
    return {name: float(np.radians(angle)) for name, angle in degrees.items()}


def _gesture(kind: Kind, share: float, phase: float) -> Angles:
    """Standing figures; the arms do what the kind says."""
    sway = 4 * np.sin(phase)
    standing = {"right_thigh": -9 + sway, "right_shin": -6 + sway, "left_thigh": 9 + sway, "left_shin": 7 + sway}
    rise = 0.5 - 0.5 * np.cos(2 * np.pi * share)
    if kind == "crossing":
        right, left = -38 + 95 * rise, 38 - 80 * rise
        return standing | {
            "right_upper_arm": right, "right_forearm": right + 5 + 50 * rise,
            "left_upper_arm": left, "left_forearm": left - 5 - 30 * rise,
            "right_thigh": -10 + 28 * rise, "right_shin": -8 + 22 * rise,
            "left_thigh": 10 - 26 * rise, "left_shin": 8 - 22 * rise,
        }  # fmt: skip
    if kind == "hidden":
        tuck = np.clip(2.2 * rise - 0.4, 0, 1)
        arm = {"left_upper_arm": 36 - 60 * tuck, "left_forearm": 28 - 193 * tuck}
        return standing | arm | {"right_upper_arm": -36 + sway, "right_forearm": -28 + 2 * sway}
    out = -75 * rise  # across the body, out to the side, and back: in front before the middle, behind after it
    across = {"right_upper_arm": 25 + out, "right_forearm": 75 + 1.5 * out}
    return standing | across | {"left_upper_arm": 34 + sway, "left_forearm": 30 + sway}


def _order(kind: Kind, share: float) -> np.ndarray:
    """Layers back to front."""
    names = list(NAMES)
    if kind == "order" and share > 0.5:
        arm = ["right_upper_arm", "right_forearm"]
        names = [name for name in names if name not in arm]
        where = names.index("torso")
        names = names[:where] + arm + names[where:]
    return np.array([NAMES.index(name) for name in names])


def _camera(kind: Camera, share: float, size: tuple[int, int]) -> np.ndarray:
    """video_from_world."""
    if kind == "pan":
        return np.array([[1.0, 0, size[0] * -0.9 * (share - 0.5)], [0, 1.0, size[1] * 0.06 * np.sin(5 * share)]])
    if kind == "zoom":
        return _about((size[0] / 2, size[1] * 0.85), 0.75 + 0.5 * share, 0.0)
    return np.array([[1.0, 0, 0], [0, 1.0, 0]])


def _about(centre: tuple[float, float], scale: float, radians: float) -> np.ndarray:
    """Turn (x towards y) and scale around a point."""
    linear = scale * np.array([[np.cos(radians), -np.sin(radians)], [np.sin(radians), np.cos(radians)]])
    return np.column_stack([linear, np.array(centre) - linear @ np.array(centre)])


def _after(a_from_b: np.ndarray, b_from_c: np.ndarray) -> np.ndarray:
    linear = a_from_b[..., :2] @ b_from_c[..., :2]
    shift = a_from_b[..., :2] @ b_from_c[..., 2:] + a_from_b[..., 2:]
    return np.concatenate([linear, shift], -1)


def _inverse(a_from_b: np.ndarray) -> np.ndarray:
    linear = np.linalg.inv(a_from_b[:, :2])
    return np.column_stack([linear, -linear @ a_from_b[:, 2]])


def _mapped(a_from_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ np.swapaxes(a_from_b[..., :2], -1, -2) + a_from_b[..., None, :, 2]


def _opencv(a_from_b: np.ndarray) -> np.ndarray:
    """Corner origin to OpenCV's pixel centres."""
    half = np.array([[0.5], [0.5]])
    return np.concatenate([a_from_b[:, :2], a_from_b[:, 2:] + a_from_b[:, :2] @ half - half], -1)


assert CANVAS[1] > FIGURE_HEIGHT
