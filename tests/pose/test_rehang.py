"""A limb goes where the rest of the pose leaves something to explain: checked against every pose there is."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from tests.pose.boxes import COLOURS, box_puppet
from wildpuppet.geometry import affine
from wildpuppet.pose import evidence as ev
from wildpuppet.pose.dynamic import Solution, Springs, pull_table, solve
from wildpuppet.pose.moves import spring_cost
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.rehang import SEAT, Picture, hung_anew, seated_anew
from wildpuppet.pose.templates import Templates, make_templates, palette_of, part_images
from wildpuppet.pose.tree import tree_of
from wildpuppet.puppet.colour import lab
from wildpuppet.render.render import mesh_of
from wildpuppet.render.texture import texture_at

ANGLES = 12
SIZE = (64, 48)
BODY, LEFT, RIGHT = 0, 1, 2
PUPPET = box_puppet(
    [(26, 16, 12, 12), (28, 26, 3, 12), (33, 26, 3, 12)],
    [(BODY, LEFT, (29.5, 27.0)), (BODY, RIGHT, (34.5, 27.0))],
    colours=(COLOURS[0], COLOURS[1], COLOURS[1]),
)
"""A body and two legs of one colour."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A frame of two legs that stand apart, and what the search makes of it."""

    picture: Picture
    solution: Solution
    templates: Templates

    def vertices(self, states: tuple[tuple[int, int, int], ...]) -> np.ndarray:
        table = np.array(states)
        maps = affine.similarity(np.ones(3), self.templates.radians[table[:, 0]], np.zeros((3, 2)))
        pivots = np.stack([image.pivot for image in self.solution.images])
        maps[:, :, 2] = table[:, 1:] + 0.5 - affine.apply(maps, pivots[:, None])[:, 0]
        return pose_vertices(PUPPET, maps[None])[0]

    def cost(self, states: tuple[tuple[int, int, int], ...]) -> float:
        """The composite's cost of a whole pose."""
        picture = self.picture
        pixels = ev.unexplained_cost(
            picture.evidence, self.vertices(states)[None], np.array([[0, 1, 2]]), picture.mesh, picture.texture
        )[0]
        return float(picture.unit * pixels + spring_cost(self.solution, np.array([states]))[0])


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    rgb = np.zeros((*SIZE[::-1], 3), np.float32)
    rgb[16:28, 26:38] = np.array(COLOURS[0]) / 255
    legs = np.zeros(SIZE[::-1], np.uint8)
    for foot in ((20, 36), (44, 36)):
        cv2.line(legs, (29 if foot[0] < 32 else 34, 27), foot, 1, 3)
    rgb[(legs > 0) & (rgb.sum(-1) == 0)] = np.array(COLOURS[1]) / 255
    evidence = ev.Evidence(lab(rgb), (rgb.sum(-1) > 0).astype(np.float32))
    images = part_images(PUPPET)
    palette = palette_of(images, 1.0, 8)
    templates = make_templates(images, 1.0, ANGLES, palette)
    springs = Springs(pull_table(2.0, 0.02, 10), pull_table(4.0, 0.02, 10), pull_table(1.0, 0.02, 10), 0.02, 0.02)
    unary = [np.zeros((ANGLES, *SIZE[::-1]), np.float32) for _ in images]
    solution = solve(unary, tree_of(PUPPET), images, templates, springs)
    wrong = ev.colours_wrong(evidence, palette)
    texture = ev.lab_texture(texture_at(PUPPET, 1.0))
    return Drawn(Picture(evidence, wrong, mesh_of(PUPPET), texture, 0.02), solution, templates)


def standing(drawn: Drawn) -> list[tuple[int, int, int]]:
    return [(0, int(image.pivot[0]), int(image.pivot[1])) for image in drawn.solution.images]


def best_alone(drawn: Drawn, states: list[tuple[int, int, int]], layer: int) -> tuple[float, tuple[int, int, int]]:
    """Try every angle and place of one part, all else as it is."""
    x0, y0 = states[BODY][1:]
    found = []
    for angle in range(ANGLES):
        for y in range(y0 - 2, y0 + 22):
            for x in range(x0 - 18, x0 + 18):
                tried = tuple((angle, x, y) if k == layer else state for k, state in enumerate(states))
                found.append((drawn.cost(tried), (angle, x, y)))
    return min(found)


def test_the_limb_gets_the_best_of_all_its_poses(drawn: Drawn) -> None:
    states = standing(drawn)
    least, _ = best_alone(drawn, states, LEFT)
    found = hung_anew(
        drawn.picture, drawn.solution, tuple(states), (0, 1, 2), drawn.vertices(tuple(states)), LEFT, [LEFT], 1
    )
    assert drawn.cost(found[0]) == pytest.approx(least, abs=0.02)
    assert drawn.cost(found[0]) < drawn.cost(tuple(states)) - 0.2
    assert found[0][RIGHT] == states[RIGHT]
    assert found[0][BODY] == states[BODY]


def test_a_leg_leaves_the_place_that_its_sister_explains(drawn: Drawn) -> None:
    states = standing(drawn)
    _, states[RIGHT] = best_alone(drawn, states, RIGHT)
    states[LEFT] = states[RIGHT]
    both = tuple(states)
    found = hung_anew(drawn.picture, drawn.solution, both, (0, 1, 2), drawn.vertices(both), LEFT, [LEFT], 1)[0]
    middle = states[BODY][1]
    assert (found[LEFT][1] - middle) * (states[RIGHT][1] - middle) < 0
    assert drawn.cost(found) < drawn.cost(both) - 0.2


def test_the_root_gets_the_best_place_near_by(drawn: Drawn) -> None:
    states = standing(drawn)
    states[BODY] = (1, states[BODY][1] + 4, states[BODY][2] - 3)
    off = tuple(states)
    found = seated_anew(drawn.picture, drawn.solution, off, (0, 1, 2), drawn.vertices(off))
    assert drawn.solution.tree.root == BODY
    assert found[1:] == off[1:]
    reach = round(SEAT * max(SIZE))
    moves = range(-reach, reach + 1)
    _, x, y = off[BODY]
    least = min(
        drawn.cost(((angle, x + dx, y + dy), *off[1:])) for angle in range(ANGLES) for dx in moves for dy in moves
    )
    assert drawn.cost(found) == pytest.approx(least, abs=0.02)
    assert drawn.cost(found) < drawn.cost(off) - 0.2
