"""Clips drawn by OpenCV with exact truth: a cut-out figure posed by forward kinematics over a painted background.

    scene = make_scene("walk", frames=24, size=(320, 240), seed=0)
    stress = stress_clip("crossing")

``make`` has the scenes that many tests use, ``stress`` one short clip for each thing that makes fitting hard. Both say
what is to be seen as a ``Film`` (poses, camera, order, light, art), which draws a ``Scene`` (frames and truth).
"""

from tests.scenes.make import make_scene
from tests.scenes.motion import Camera, Kind
from tests.scenes.scene import Scene, write_clip
from tests.scenes.stress import STRESS, StressClip, stress_clip

__all__ = ["STRESS", "Camera", "Kind", "Scene", "StressClip", "make_scene", "stress_clip", "write_clip"]
