"""A drawn scene as the library's values: whole frames as crops, and the true poses."""

import numpy as np

from tests.scenes import Scene
from wildpuppet.types import Crops, Poses, Puppet


def crops_of(scene: Scene) -> Crops:
    """Whole frames as crops, with the true coverage as matte."""
    num_frames, height, width = scene.frames.shape[:3]
    identity = np.tile(np.array([[1.0, 0, 0], [0, 1.0, 0]]), (num_frames, 1, 1))
    shot = np.searchsorted(scene.shot_starts, np.arange(num_frames), side="right") - 1
    return Crops(
        frames=np.arange(num_frames),
        size=(width, height),
        video_from_crop=identity,
        images=np.concatenate([scene.frames, scene.alpha[..., None]], -1),
        box_crop=scene.boxes,
        drawing=scene.drawing,
        shot=shot,
        state=("followed",) * num_frames,
        reference=0,
    )


def true_poses(scene: Scene) -> Poses:
    """The poses that the scene was drawn with; crops are whole frames."""
    zeros = np.zeros(len(scene.frames))
    return Poses(crop_from_canvas=scene.video_from_canvas, order=scene.order, cost=zeros, margin=zeros + 1.0)


def standing_poses(scene: Scene) -> Poses:
    """The rest pose in every frame, as its torso stands in the first: what there is without a search."""
    torso = scene.video_from_canvas[0, scene.layer("torso")]
    true = true_poses(scene)
    return Poses(np.broadcast_to(torso, scene.video_from_canvas.shape).copy(), true.order, true.cost, true.margin)


def true_vertices(scene: Scene, puppet: Puppet) -> np.ndarray:
    """Where the puppet's vertices truly are: (T, V, 2)."""
    maps = scene.video_from_canvas[:, puppet.layer_of_vertex]
    return (maps[..., :2] @ puppet.vertices[:, :, None])[..., 0] + maps[..., 2]
