"""A leg drawn in the other leg's shape is known by its shade."""

import cv2
import numpy as np

from tests.pose.boxes import box_puppet
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.search import search
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops

NEAR, FAR, BODY = (196, 110, 60), (140, 72, 40), (70, 120, 200)
SIZE = (160, 160)
LEFT, RIGHT = (60, 80, 12, 50), (84, 80, 20, 32)
"""Legs of unlike shapes: x, y, width, height."""
PUPPET = box_puppet(
    [(56, 40, 50, 46), LEFT, RIGHT],
    [(0, 1, (66.0, 84.0)), (0, 2, (94.0, 84.0))],
    canvas=SIZE,
    colours=(BODY, NEAR, FAR),
)


def frame(left: tuple[int, int, int], right: tuple[int, int, int]) -> np.ndarray:
    picture = np.zeros((*SIZE[::-1], 4), np.uint8)
    for (x, y, width, height), colour in ((LEFT, left), (RIGHT, right), ((56, 40, 50, 46), BODY)):
        cv2.rectangle(picture, (x, y), (x + width - 1, y + height - 1), (*colour, 255), -1)
    return picture


def middles(left: tuple[int, int, int], right: tuple[int, int, int]) -> np.ndarray:
    """Where the search puts the near and the far leg's middle."""
    picture = frame(left, right)
    crops = Crops(
        np.zeros(1, int), SIZE, np.array([[[1.0, 0, 0], [0, 1.0, 0]]]), picture[None], np.array([[50.0, 35, 60, 100]]),
        np.zeros(1, int), np.zeros(1, int), ("followed",), None, False,
    )  # fmt: skip
    settings = SearchSettings(box_pixels=48, angles=24)
    placement = affine.scale_and_shift(1.0, (0.0, 0.0))
    found = search(PUPPET, crops, placement, 1.0, np.array([0]), settings, Machine(workers=1))
    vertices = pose_vertices(PUPPET, found.crop_from_canvas[:, 0])[0]
    return np.stack([vertices[PUPPET.layer_of_vertex == layer].mean(0) for layer in (1, 2)])


def test_as_drawn_both_stay():
    near, far = middles(NEAR, FAR)
    assert near[0] < 74 < far[0]


def test_each_in_the_other_legs_shape_is_found_by_its_shade():
    near, far = middles(FAR, NEAR)
    assert far[0] < near[0]


def test_without_a_difference_of_shade_the_shape_decides():
    near, far = middles(NEAR, NEAR)
    assert near[0] < 74 < far[0]
