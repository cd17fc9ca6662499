"""Parts that bend: which do, how they move, and that the search bends a leg as it is drawn."""

import numpy as np
import pytest
import torch

from wildpuppet.machine import Machine
from wildpuppet.pose.pieces import pieces_of
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.search import search
from wildpuppet.puppet.bends import is_of_half, with_bends
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings, SearchSettings
from wildpuppet.types import Crops, CutOut, JointSpec, Part, Puppet

torch.set_num_threads(1)
SIDE, WIDTH = 200, 18.0
HIP, KNEE, FOOT = np.array([100.0, 80.0]), np.array([100.0, 130.0]), np.array([100.0, 180.0])
COLOURS = {"body": (200, 40, 40), "thigh": (40, 60, 200), "shin": (60, 170, 60)}
RIGID = PuppetSettings(edge=0.06, slender=0.0)
BENT = PuppetSettings(edge=0.06)
REST = np.array([[1.0, 0, 0], [0, 1.0, 0]])


def capsule(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Mark the pixels within half the width of a segment."""
    points = np.stack(np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5), -1)
    share = ((points - start) @ (end - start) / ((end - start) @ (end - start))).clip(0, 1)
    return np.linalg.norm(points - start - share[..., None] * (end - start), axis=-1) <= WIDTH / 2


def disc(centre: tuple[float, float], radius: float) -> np.ndarray:
    across = np.arange(SIDE) + 0.5
    return np.hypot(across - centre[0], across[:, None] - centre[1]) <= radius


def painted(*layers: tuple[np.ndarray, str]) -> np.ndarray:
    picture = np.zeros((SIDE, SIDE, 4), np.uint8)
    for mask, colour in layers:
        picture[mask] = (*COLOURS[colour], 255)
    return picture


def turned(point: np.ndarray, radians: float, about: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(radians), np.sin(radians)
    return about + (point - about) @ np.array([[cos, -sin], [sin, cos]]).T


def leg(hip: float, knee: float) -> tuple[tuple[np.ndarray, str], tuple[np.ndarray, str]]:
    """Draw the leg turned at its hip and, against the thigh, at its knee (radians)."""
    shin = turned(turned(FOOT, knee, KNEE), hip, HIP)
    middle = turned(KNEE, hip, HIP)
    return (capsule(HIP, middle), "thigh"), (capsule(middle, shin), "shin")


def cutout(*more: Part) -> CutOut:
    body = Part("body", painted((disc((100.0, 50.0), 40.0), "body")))
    return CutOut(
        (SIDE, SIDE), (Part("leg", painted(*leg(0, 0))), body, *more), (JointSpec(("body", "leg"), (100, 80)),)
    )


def whole_maps(puppet: Puppet, knee: float) -> np.ndarray:
    """Maps of the pieces, the leg's lower one turned about its bend."""
    maps = np.repeat(REST[None], len(puppet.layer_of_piece), 0)
    cos, sin = np.cos(knee), np.sin(knee)
    lower = int(np.searchsorted(puppet.layer_of_piece, 0, "right")) - 1
    maps[lower, :, :2] = [[cos, -sin], [sin, cos]]
    maps[lower, :, 2] = puppet.bend_points[0] - maps[lower, :, :2] @ puppet.bend_points[0]
    return maps


def test_slender_parts_of_some_size_bend_in_the_middle():
    stick = Part(
        "stick", painted((capsule(np.array([20.0, 100.0]), np.array([20.0, 190.0])) & disc((20, 145), 46), "shin"))
    )
    stick.rgba[:, :18] = stick.rgba[:, 22:] = 0  # four pixels wide
    short = Part("short", painted((capsule(np.array([150.0, 150.0]), np.array([150.0, 180.0])), "shin")))
    puppet = build(cutout(stick, short), BENT)
    assert [puppet.names[layer] for layer in puppet.bend_layers] == ["leg"]
    np.testing.assert_allclose(puppet.bend_points[0], (HIP + FOOT) / 2, atol=1.0)
    along = puppet.bend_axes[0] / np.linalg.norm(puppet.bend_axes[0])
    assert abs(along[1]) == pytest.approx(1.0, abs=1e-3)
    assert np.linalg.norm(puppet.bend_axes[0]) == pytest.approx(WIDTH / 2, abs=1.0)
    assert len(build(cutout(), RIGID).bend_layers) == 0


def test_what_looks_like_a_part_that_bends_bends_too():
    other = np.array([40.0, 0.0])
    shorter = FOOT + other - (0, 18)
    upper, lower = (capsule(HIP + other, KNEE + other), "thigh"), (capsule(KNEE + other, shorter), "shin")
    twin = Part("twin", painted(upper, lower))
    alone = build(CutOut((SIDE, SIDE), (*cutout().parts[1:], twin)), PuppetSettings(edge=0.06, slender=5.4))
    both = build(cutout(twin), PuppetSettings(edge=0.06, slender=5.4))
    assert len(alone.bend_layers) == 0
    assert [both.names[layer] for layer in both.bend_layers] == ["leg", "twin"]


def test_pieces_move_as_wholes_and_the_part_goes_over_smoothly():
    puppet = build(cutout(), BENT)
    posed = pose_vertices(puppet, whole_maps(puppet, 1.0))
    axis = puppet.bend_axes[0] / (puppet.bend_axes[0] @ puppet.bend_axes[0])
    beyond = (puppet.vertices - puppet.bend_points[0]) @ axis
    is_leg = puppet.layer_of_vertex == 0
    np.testing.assert_allclose(posed[~is_leg | (beyond < -1)], puppet.vertices[~is_leg | (beyond < -1)], atol=1e-9)
    lower = is_leg & (beyond > 1)
    np.testing.assert_allclose(posed[lower], turned(puppet.vertices[lower], 1.0, puppet.bend_points[0]), atol=1e-9)
    still = pose_vertices(puppet, np.repeat(REST[None], 3, 0))
    np.testing.assert_allclose(still, puppet.vertices, atol=1e-9)
    np.testing.assert_array_equal(pose_vertices(puppet, np.repeat(REST[None], 2, 0)), puppet.vertices)  # a map a layer


def test_pieces_share_the_disc_about_the_bend_and_hang_together():
    puppet = build(cutout(), BENT)
    pieces = pieces_of(puppet)
    parted = pieces.puppet
    assert parted.num_layers == 3
    assert parted.joint_layers.tolist()[-1] == [0, 1]
    np.testing.assert_array_equal(parted.vertices, puppet.vertices[pieces.vertex])
    masks = []
    for piece in (0, 1):
        mine = parted.layer_of_vertex == piece
        shift = (parted.uv - parted.vertices)[mine][0].astype(int)
        low, high = (
            np.floor(parted.vertices[mine].min(0)).astype(int),
            np.ceil(parted.vertices[mine].max(0)).astype(int),
        )
        mask = np.zeros((SIDE, SIDE), bool)
        patch = parted.atlas[low[1] + shift[1] : high[1] + shift[1], low[0] + shift[0] : high[0] + shift[0], 3]
        mask[low[1] : high[1], low[0] : high[0]] = patch > 127
        masks.append(mask)
    whole = cutout().parts[0].rgba[..., 3] > 127
    np.testing.assert_array_equal(masks[0] | masks[1], whole)
    points = np.stack(np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5), -1)
    halves = [is_of_half(points, puppet.bend_points[0], puppet.bend_axes[0], side) & whole for side in (-1, 1)]
    np.testing.assert_array_equal(masks, halves)
    shared = masks[0] & masks[1]
    assert np.pi * (WIDTH / 2) ** 2 <= shared.sum() <= np.pi * (WIDTH / 2 + 3) ** 2


def test_orders_of_layers_and_of_pieces():
    pieces = pieces_of(build(cutout(), BENT))
    orders = np.array([[0, 1], [1, 0]])
    assert pieces.parted(orders).tolist() == [[0, 1, 2], [2, 0, 1]]
    np.testing.assert_array_equal(pieces.joined(pieces.parted(orders)), orders)


@pytest.mark.parametrize(("hip", "knee"), [(-0.5, 1.2), (0.7, -1.5)])
def test_a_bent_leg_is_found(hip, knee):
    frame = painted(*leg(hip, knee), (disc((100.0, 50.0), 40.0), "body"))
    crops = Crops(
        np.arange(1), (SIDE, SIDE), REST[None], frame[None], np.array([[40.0, 10, 120, 180]]), np.arange(1),
        np.zeros(1, np.int64), ("followed",), None, ordered=False,
    )  # fmt: skip
    off = {}
    for name, settings in (("rigid", RIGID), ("bent", BENT)):
        puppet = build(cutout(), settings)
        found = search(
            puppet, crops, REST, 1.0, np.arange(1), SearchSettings(box_pixels=48, angles=36), Machine(workers=1)
        )
        posed = pose_vertices(puppet, found.crop_from_canvas[0, 0])
        is_foot = (puppet.layer_of_vertex == 0) & (puppet.vertices[:, 1] > 150)
        true = turned(turned(puppet.vertices[is_foot], knee, KNEE), hip, HIP)
        off[name] = np.median(np.linalg.norm(posed[is_foot] - true, axis=1)) / (FOOT[1] - 10)
    assert off["bent"] < 0.03
    assert off["rigid"] > 0.06


def test_nothing_bends_at_zero():
    puppet = build(cutout(), RIGID)
    assert with_bends(puppet, 0.0) is puppet
    assert pieces_of(puppet).puppet is puppet
