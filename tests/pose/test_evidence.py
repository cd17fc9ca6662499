import numpy as np
import pytest
import torch
from skimage.color import rgb2lab

from tests.figure import LIMBS
from tests.pose.boxes import box_puppet
from tests.scenes import Scene, make_scene
from wildpuppet.geometry import affine
from wildpuppet.pose.evidence import (
    BEHIND,
    SIGMA,
    SMOOTH,
    colours_wrong,
    disagreement_maps,
    evidence_of,
    lab_texture,
    unexplained_cost,
)
from wildpuppet.pose.kernels import template_costs
from wildpuppet.pose.place import pose_vertices, size_of
from wildpuppet.pose.templates import make_templates, palette_of, part_images
from wildpuppet.puppet.build import build
from wildpuppet.render.render import mesh_of
from wildpuppet.render.texture import texture_at
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import Puppet

torch.set_num_threads(1)
SIDE, LEFT, TOP = 11, 21, 15
PAINT, GROUND = (200, 40, 40), (90, 100, 110)
SQUARE = box_puppet([(LEFT, TOP, SIDE, SIDE)], colours=[PAINT])
TWO = box_puppet([(LEFT, TOP, SIDE, SIDE), (LEFT, TOP, SIDE, SIDE)], colours=[PAINT, PAINT])


@pytest.fixture(params=[0.0, 0.4], ids=["clip", "drawing"])
def cover(request: pytest.FixtureRequest) -> float:
    """What a pixel that is surely the character's costs beside 1 when no part explains it."""
    return float(request.param)


def frame(matte_ground: int = 0, matte_square: int = 255) -> np.ndarray:
    """The square on a flat ground, RGBA."""
    picture = np.full((48, 64, 4), (*GROUND, matte_ground), np.uint8)
    picture[TOP : TOP + SIDE, LEFT : LEFT + SIDE] = (*PAINT, matte_square)
    return picture


def cost_of(picture: np.ndarray, puppet: Puppet = SQUARE, shifts=((0, 0),), cover: float = 0.0) -> np.ndarray:
    """Cost with the whole puppet shifted by each of ``shifts``."""
    vertices = np.stack([puppet.vertices + np.array(shift, float) for shift in shifts])
    order = np.tile(np.arange(puppet.num_layers), (len(shifts), 1))
    texture = lab_texture(texture_at(puppet, 1.0))
    return unexplained_cost(evidence_of(picture, 1.0, cover), vertices, order, mesh_of(puppet), texture)


def wrong(first: tuple[int, int, int], second: tuple[int, int, int]) -> float:
    """Disagreement of two colours by its formula."""
    a, b = (rgb2lab(np.array([[colour]], np.uint8))[0, 0] for colour in (first, second))
    return float(1 - np.exp(-(np.hypot(np.linalg.norm(a - b), SMOOTH) - SMOOTH) / SIGMA))


def test_flat_square_by_hand(cover):
    steps = (0, 1, 4, SIDE + 2)
    costs = cost_of(frame(), shifts=[(step, 0) for step in steps], cover=cover)
    strip = 1 + cover + wrong(PAINT, GROUND) + BEHIND  # uncovered behind, wrongly covered in front, per pixel
    expected = [SIDE * min(step, SIDE) * strip for step in steps]
    # the texture's edge and 8-bit alpha leave a little even in place
    np.testing.assert_allclose(costs, expected, atol=0.02 * SIDE**2)


def test_wrong_colour_costs_as_much_as_leaving_it_or_less_by_the_cover(cover):
    other = box_puppet([(LEFT, TOP, SIDE, SIDE)], colours=[(20, 60, 250)])
    far = cost_of(frame(), other, [(0, 0), (0, SIDE + 5)], cover)
    assert far[0] == pytest.approx(SIDE**2 * wrong(PAINT, (20, 60, 250)), rel=0.02)
    assert wrong(PAINT, (20, 60, 250)) == pytest.approx(1.0, abs=0.05)
    elsewhere = BEHIND + wrong(GROUND, (20, 60, 250))
    assert far[1] == pytest.approx(SIDE**2 * (1 + cover + elsewhere), rel=0.02)


def test_two_parts_gain_nothing_on_one_place(cover):
    picture = frame()
    picture[TOP : TOP + SIDE, LEFT + SIDE + 4 : LEFT + 2 * SIDE + 4] = (*PAINT, 255)  # a second square
    both = TWO.vertices + np.where(TWO.layer_of_vertex[:, None] == 1, [[SIDE + 4.0, 0.0]], 0.0)
    texture, order = lab_texture(texture_at(TWO, 1.0)), np.array([[0, 1]])
    apart = unexplained_cost(evidence_of(picture, 1.0, cover), both[None], order, mesh_of(TWO), texture)
    assert apart[0] == pytest.approx(0, abs=0.04 * SIDE**2)
    assert cost_of(picture, TWO, cover=cover)[0] == pytest.approx(SIDE**2 * (1 + cover), rel=0.05)


def test_where_the_matte_does_not_know_agreeing_colours_are_worth_claiming(cover):
    here, away = cost_of(frame(128, 128), shifts=[(0, 0), (0, SIDE + 5)], cover=cover)
    matte = 128 / 255
    left = matte + cover * (2 * matte - 1)
    assert here == pytest.approx((48 * 64 - SIDE**2) * left, rel=0.01)
    assert away == pytest.approx(48 * 64 * left + SIDE**2 * (wrong(PAINT, GROUND) - left), rel=0.01)


def test_template_cost_in_place_is_minus_what_it_explains(cover):
    images = part_images(SQUARE)
    palette = palette_of(images, 1.0, 4)
    templates = make_templates(images, 1.0, 8, palette)
    evidence = evidence_of(frame(), 1.0, cover)
    maps = disagreement_maps(evidence, colours_wrong(evidence, palette), templates.reach)
    costs = template_costs(
        maps, templates.pixels, templates.weights, templates.start[0], templates.count[0], templates.reach, 48, 64
    )
    angle, y, x = np.unravel_index(costs.argmin(), costs.shape)
    assert (angle % 2, y, x) == (0, TOP + SIDE // 2, LEFT + SIDE // 2)  # a square: any quarter turn
    assert costs.min() == pytest.approx(-(1 + cover) * SIDE**2, rel=0.02)
    assert costs[0, 5, 5] == pytest.approx((wrong(PAINT, GROUND) + BEHIND) * SIDE**2, rel=0.1)


def test_evidence_shrinks_by_areas():
    picture = np.zeros((40, 48, 4), np.uint8)
    picture[:, 8:16] = 255
    small = evidence_of(picture, 0.25)
    assert small.matte.shape == (10, 12)
    np.testing.assert_allclose(small.matte, np.tile([0, 0, 1, 1] + 8 * [0], (10, 1)))
    np.testing.assert_allclose(small.lab[0, 2], [100, 0, 0], atol=0.1)


SCALE = 0.7
"""Search pixels per video pixel."""


@pytest.fixture(scope="module")
def figure() -> tuple[Scene, Puppet]:
    scene = make_scene("walk", frames=5, size=(192, 144))
    return scene, build(scene.cutout, PuppetSettings(edge=0.1))


@pytest.mark.parametrize("frame_index", [1, 3])
def test_true_pose_of_a_figure_costs_least(figure, frame_index):
    scene, puppet = figure
    image = np.concatenate([scene.frames[frame_index], scene.alpha[frame_index, ..., None]], -1)
    true = SCALE * scene.video_from_canvas[frame_index]
    poses = [true, *worse_poses(scene, puppet, true).values()]
    vertices = np.stack([pose_vertices(puppet, pose) for pose in poses])
    order = np.repeat(scene.order[frame_index : frame_index + 1], len(poses), 0)
    texture = lab_texture(texture_at(puppet, size_of(true[0])))
    best, *costs = unexplained_cost(evidence_of(image, SCALE), vertices, order, mesh_of(puppet), texture)
    for name, cost in zip(worse_poses(scene, puppet, true), costs, strict=True):
        assert cost > 1.08 * best, name


def worse_poses(scene: Scene, puppet: Puppet, true: np.ndarray) -> dict[str, np.ndarray]:
    """Poses that a search could mistake for the true one."""
    vertices = pose_vertices(puppet, true)
    step, middle = 0.03 * np.ptp(vertices, axis=0).max(), vertices.mean(0)
    poses = {"legs swapped": with_swapped_legs(scene, true)}
    for name, shift in {"right": (step, 0), "left": (-step, 0), "up": (0, -step), "down": (0, step)}.items():
        poses[f"moved {name}"] = affine.compose(affine.scale_and_shift(1.0, shift), true)
    for scale in (0.9, 1.1):
        poses[f"scaled by {scale}"] = affine.compose(affine.scale_and_shift(scale, tuple((1 - scale) * middle)), true)
    for part in ("right_forearm", "left_shin", "head"):
        layer = scene.layer(part)
        pose = poses[f"{part} missing"] = true.copy()
        pose[layer, :, 2] += 1000.0
        for degrees in (-25.0, 25.0):
            pose = poses[f"{part} turned by {degrees}"] = true.copy()
            pose[layer] = affine.compose(about(vertices[puppet.layer_of_vertex == layer], degrees), true[layer])
    return poses


def about(points: np.ndarray, degrees: float) -> np.ndarray:
    """Turn about the points' middle."""
    turn, middle = affine.similarity(np.array(1.0), np.array(np.radians(degrees)), np.zeros(2)), points.mean(0)
    turn[:, 2] = middle - turn[:, :2] @ middle
    return turn


def with_swapped_legs(scene: Scene, true: np.ndarray) -> np.ndarray:
    """Each leg from its own hip in the directions of the other."""
    swapped, limbs = true.copy(), {part.name: part for part in LIMBS}
    for own, other in (("left", "right"), ("right", "left")):
        for bone in ("thigh", "shin"):
            mine, model = limbs[f"{own}_{bone}"], limbs[f"{other}_{bone}"]
            map_of_model = true[scene.layer(model.name)]
            turn = np.arctan2(map_of_model[1, 0], map_of_model[0, 0]) + mine.rest_radians - model.rest_radians
            place = affine.similarity(np.array(size_of(map_of_model)), np.array(turn), np.zeros(2))
            hinge = np.array([mine.hinge], float)
            place[:, 2] = (affine.apply(swapped[scene.layer(mine.parent)], hinge) - affine.apply(place, hinge))[0]
            swapped[scene.layer(mine.name)] = place
    return swapped
