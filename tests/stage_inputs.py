"""A tiny input for every stage, drawn or true: no stage's input is what another stage found, as far as that can be.

``INPUTS`` has a function for each stage; its answer is what ``Stage.run`` takes before the settings.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.scene_values import crops_of, standing_poses, true_poses, true_vertices
from tests.scenes import Scene, make_scene, write_clip
from wildpuppet.fit.descent import LOSS_NAMES
from wildpuppet.machine import Machine
from wildpuppet.puppet.build import build
from wildpuppet.settings import ProbeSettings, PuppetSettings
from wildpuppet.types import Clip, Crops, Fit, Followed, Hypotheses, Keyframe, Poses, Puppet, Target, Track
from wildpuppet.video.probe import probe

FRAMES, SIZE, SHIFT = 4, (112, 84), 1.5


@dataclass(frozen=True)
class Drawn:
    """The first drawings of a crossing, two of them one held drawing, and true values of every kind."""

    folder: Path

    @cached_property
    def scene(self) -> Scene:
        whole = make_scene("crossing", frames=12, size=SIZE, seed=5, hold=2, cycles=0.5)
        names = ("frames", "video_from_canvas", "boxes", "order", "alpha", "drawing")
        return replace(whole, **{name: getattr(whole, name)[4 : 4 + FRAMES] for name in names})

    @cached_property
    def video(self) -> Path:
        return write_clip(self.scene, self.folder / "clip.mp4")

    @cached_property
    def drawings(self) -> Path:
        folder = self.folder / "drawings"
        folder.mkdir()
        for index, picture in enumerate(np.concatenate([self.scene.frames, self.scene.alpha[..., None]], -1)):
            Image.fromarray(picture).save(folder / f"{index}.png")
        return folder

    @cached_property
    def clip(self) -> Clip:
        return probe(self.video, ProbeSettings(), Machine("cpu"))

    @cached_property
    def target(self) -> Target:
        x, y, width, height = self.scene.boxes[1].tolist()
        return Target((x, y, width, height), 1, 0, FRAMES)

    @cached_property
    def track(self) -> Track:
        known = ("followed",) * FRAMES
        return Track(np.arange(FRAMES), self.scene.boxes, known, np.ones(FRAMES), np.zeros(FRAMES, np.int64))

    @cached_property
    def crops(self) -> Crops:
        return replace(crops_of(self.scene), drawing=self.scene.drawing - self.scene.drawing.min(), reference=1)

    @cached_property
    def puppet(self) -> Puppet:
        return build(self.scene.cutout, PuppetSettings(edge=0.25))

    @cached_property
    def placement(self) -> np.ndarray:
        return standing_poses(self.scene).crop_from_canvas[1, self.scene.layer("torso")]

    @cached_property
    def poses(self) -> Poses:
        """The true poses, each part moved by a pixel or two."""
        true = true_poses(self.scene)
        maps = true.crop_from_canvas.copy()
        maps[..., 2] += np.random.default_rng(1).normal(0.0, SHIFT, maps[..., 2].shape)
        return replace(true, crop_from_canvas=maps)

    @cached_property
    def hypotheses(self) -> Hypotheses:
        """Two shifted poses and the standing one, all of like cost."""
        maps = np.stack([self.poses.crop_from_canvas, standing_poses(self.scene).crop_from_canvas], 1)
        maps = np.concatenate([maps, maps[:, :1] + np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 0.0]])], 1)
        order = np.repeat(self.scene.order[:, None], 3, 1)
        return Hypotheses(maps, order, np.linspace(0.3, 0.4, 3 * FRAMES).reshape(FRAMES, 3))

    @property
    def standing_first(self) -> Hypotheses:
        """The same with the standing pose taken for the best."""
        return replace(self.hypotheses, crop_from_canvas=self.hypotheses.crop_from_canvas[:, [1, 0, 2]])

    @cached_property
    def keyframe(self) -> Keyframe:
        """The right hand, truly placed, in the second frame."""
        hand = np.array([[46.0, 158.0]])
        layer = self.scene.layer("right_forearm")
        triangle = self.puppet.triangles[self.puppet.layer_of_triangle == layer][0]
        edges = self.puppet.vertices[triangle[1:]] - self.puppet.vertices[triangle[0]]
        second, third = np.linalg.solve(edges.T, hand[0] - self.puppet.vertices[triangle[0]])
        weights = np.array([[1 - second - third, second, third]])
        return Keyframe(1, triangle[None].astype(np.int64), weights, self.scene.truth(hand, layer)[1])

    @cached_property
    def followed(self) -> Followed:
        """The second frame's true pose, in the frames around it too."""
        maps = np.repeat(true_poses(self.scene).crop_from_canvas[1:2], 3, 0)
        order = np.repeat(self.scene.order[1:2], 3, 0)
        return Followed(np.arange(3), maps, order, np.array([0.35, 0.2, 0.33]), np.array([False, True, False]))

    @cached_property
    def fit(self) -> Fit:
        vertices = true_vertices(self.scene, self.puppet).astype(np.float32)
        confidence = np.linspace(0.2, 1.0, vertices[..., 0].size, dtype=np.float32).reshape(vertices.shape[:2])
        state = ("fitted", "held", "doubtful", "held")
        return Fit(np.arange(FRAMES), vertices, self.scene.order, confidence, state)

    def with_losses(self, share: float) -> Fit:
        """The fit with an energy, moved by ``share`` pixels."""
        losses = {name: share * np.array([1.0, 1.0, 3.0, 3.0]) for name in LOSS_NAMES}
        return replace(self.fit, vertices_crop=self.fit.vertices_crop + np.float32(share), losses=losses)

    def pieces(self, value: Any, names: tuple[str, ...]) -> list[Any]:
        """Cut a value into two along its frames."""
        halves = (slice(0, 2), slice(2, FRAMES))
        return [replace(value, **{name: getattr(value, name)[half] for name in names}) for half in halves]


POSES = ("crop_from_canvas", "order", "cost", "margin")
HYPOTHESES = ("crop_from_canvas", "order", "cost")
FIT = ("frames", "vertices_crop", "order", "confidence", "state")


def _keyframes_part(drawn: Drawn) -> tuple[Any, ...]:
    return drawn.puppet, drawn.crops, drawn.placement, drawn.hypotheses, drawn.keyframe


INPUTS: dict[str, Callable[[Drawn], tuple[Any, ...]]] = {
    "probe": lambda drawn: (drawn.video,),
    "track": lambda drawn: (drawn.clip, drawn.target),
    "crop": lambda drawn: (drawn.clip, drawn.track, drawn.target),
    "drawings": lambda drawn: (drawn.drawings,),
    "automatic": lambda drawn: (drawn.clip, drawn.crops, drawn.target),
    "puppet": lambda drawn: (drawn.scene.cutout,),
    "place": lambda drawn: (drawn.puppet, drawn.crops),
    "hinges": lambda drawn: (drawn.puppet, drawn.crops, drawn.placement),
    "search.part": lambda drawn: (drawn.puppet, drawn.crops, drawn.placement, 0.3, np.array([1, 2, 3])),
    "search": lambda drawn: (drawn.pieces(drawn.hypotheses, HYPOTHESES), [2, 3, 0, 1]),
    "keyframes.part": lambda drawn: _keyframes_part(drawn),
    "keyframes": lambda drawn: (drawn.hypotheses, [drawn.followed]),
    "choose": lambda drawn: (drawn.puppet, drawn.crops, drawn.hypotheses),
    "weigh.part": lambda drawn: (drawn.puppet, drawn.crops, drawn.standing_first, slice(0, FRAMES)),
    "weigh": lambda drawn: (drawn.pieces(drawn.poses, POSES),),
    "rest": lambda drawn: (drawn.puppet, drawn.crops, drawn.placement),
    "fit.part": lambda drawn: (drawn.puppet, drawn.crops, drawn.poses, slice(0, FRAMES)),
    "fit.keyed": lambda drawn: (drawn.puppet, drawn.crops, drawn.poses, slice(0, FRAMES), [drawn.keyframe]),
    "fit": lambda drawn: (drawn.pieces(drawn.fit, FIT),),
    "distil": lambda drawn: (drawn.puppet, drawn.crops, drawn.poses, drawn.fit),
    "better": lambda drawn: (drawn.crops, drawn.with_losses(2.0), drawn.with_losses(1.0)),
    "train": lambda drawn: (drawn.puppet, drawn.crops, drawn.poses, [0, 1, 2]),
    "confidence": lambda drawn: (drawn.puppet, drawn.crops, drawn.hypotheses, drawn.poses, drawn.fit),
    "reuse": lambda drawn: (drawn.crops,),
    "exposure": lambda drawn: (drawn.clip, drawn.crops, drawn.fit, drawn.crops.drawing),
    "meshes": lambda drawn: (drawn.clip, drawn.puppet, drawn.crops, drawn.fit),
    "preview": lambda drawn: (drawn.clip, drawn.puppet, drawn.crops, drawn.fit),
}
