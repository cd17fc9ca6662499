"""A puppet's own renders with known truth: random poses, bent and redrawn parts, a background, a matte that errs.

What confidence is calibrated on (``tests.calibrate_confidence``). Nothing here is easy for the fit on purpose: limbs
turn far, hinges slip, parts stretch, change their colours and are painted over, layers change places, things stand in
front, and the matte is wrong in blots. ``clip`` moves smoothly over a background; ``drawings`` are apart from each
other on white.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import torch

from tests.figure import smooth_noise
from wildpuppet.geometry import affine
from wildpuppet.pose.place import rest_box
from wildpuppet.pose.tree import Tree, tree_of
from wildpuppet.render.render import mesh_of, render
from wildpuppet.render.surface import Surface, surface
from wildpuppet.render.texture import Texture, texture_at
from wildpuppet.types import Crops, Puppet

SIDE, CHARACTER = 336, 200.0
"""Crop pixels, and those along the larger side of the puppet at rest."""
POINTS = 200
"""Points per frame."""
Kind = Literal["drawings", "clip"]


@dataclass(frozen=True, eq=False)
class OwnRenders:
    """Crops with their truth: ``vertices`` (T, V, 2) crop pixels, ``length`` (T,) of the character's box.

    Points that are seen, drawn at random: the mix ``weights`` (T, N, 3) of the vertices ``corners`` (T, N, 3).
    """

    crops: Crops
    vertices: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    length: np.ndarray
    placement: np.ndarray


def own_renders(puppet: Puppet, kind: Kind, frames: int, hand: np.random.Generator) -> OwnRenders:
    """Draw ``frames`` poses of a puppet; the first is nearly the rest pose."""
    scale = CHARACTER / float(rest_box(puppet)[2:].max())
    tree, angles = tree_of(puppet), _angles(puppet, kind, frames, hand)
    ground = _ground(puppet, kind, hand)
    pictures, vertices, corners, weights = [], [], [], []
    for t in range(frames):
        posed = _bent(puppet, _posed(puppet, tree, angles[t], scale, hand), scale, hand)
        order = _order(tree, puppet.num_layers, hand) if t else np.arange(puppet.num_layers)
        picture, seen = _picture(puppet, posed, order, ground, kind, scale, hand)
        chosen = hand.choice(np.flatnonzero(seen.triangle[0].numpy().ravel() >= 0), POINTS)
        pictures.append(picture)
        vertices.append(posed)
        corners.append(puppet.triangles[seen.triangle[0].numpy().ravel()[chosen]])
        weights.append(seen.barycentrics[0].numpy().reshape(-1, 3)[chosen])
    images = np.stack(pictures)
    low, high = np.stack(vertices).min(1), np.stack(vertices).max(1)
    boxes = np.concatenate([low, high - low], 1)
    number = np.arange(frames)
    identity = np.tile(np.array([[1.0, 0, 0], [0, 1.0, 0]]), (frames, 1, 1))
    crops = Crops(
        number, (SIDE, SIDE), identity, images, boxes, number, np.zeros(frames, int), ("followed",) * frames,
        0 if kind == "clip" else None, kind == "clip",
    )  # fmt: skip
    box = rest_box(puppet)
    shift = SIDE / 2 - scale * (box[:2] + box[2:] / 2)
    placement = np.column_stack([scale * np.eye(2), shift])
    return OwnRenders(crops, np.stack(vertices), np.stack(corners), np.stack(weights), boxes[:, 2:].max(1), placement)


def _angles(puppet: Puppet, kind: Kind, frames: int, hand: np.random.Generator) -> np.ndarray:
    """Turn of every layer against its parent, radians, (T, L)."""
    num = puppet.num_layers
    if kind == "drawings":
        angles = hand.normal(0, 0.9, (frames, num))
    else:
        rate, phase = hand.uniform(0.5, 1.5, num), hand.uniform(0, 2 * np.pi, num)
        swing = np.abs(hand.normal(0, 0.9, num))
        angles = swing * np.sin(2 * np.pi * rate * np.arange(frames)[:, None] / 16 + phase)
    angles[0] *= 0.1
    return angles


def _posed(puppet: Puppet, tree: Tree, angles: np.ndarray, scale: float, hand: np.random.Generator) -> np.ndarray:
    """Forward kinematics with hinges that slip and parts that stretch; crop pixels."""
    box = rest_box(puppet)
    middle = box[:2] + box[2:] / 2
    size = scale * hand.normal(1.0, 0.02)
    away = hand.normal(0, 0.02 * CHARACTER, 2)
    maps = np.zeros((puppet.num_layers, 2, 3))
    maps[tree.root] = _turn(0.2 * angles[tree.root], np.eye(2) * size, middle, SIDE / 2 + away)
    for edge in tree.edges:
        slip = hand.normal(0, 0.02 * CHARACTER, 2)
        parent = maps[edge.parent]
        place = parent[:, :2] @ np.array(edge.at) + parent[:, 2] + slip
        rotation = parent[:, :2] / np.sqrt(abs(np.linalg.det(parent[:, :2]))) * size
        strain = np.diag(hand.normal(1.0, 0.08, 2))
        maps[edge.child] = _turn(angles[edge.child], rotation @ strain, np.array(edge.at), place)
    return affine.apply(maps[puppet.layer_of_vertex], puppet.vertices[:, None])[:, 0]


def _turn(radians: float, linear: np.ndarray, about: np.ndarray, to: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(radians), np.sin(radians)
    turned = linear @ np.array([[cos, -sin], [sin, cos]])
    return np.column_stack([turned, to - turned @ about])


def _bent(puppet: Puppet, posed: np.ndarray, scale: float, hand: np.random.Generator) -> np.ndarray:
    """Bend every part by a smooth field of its own."""
    bent = posed.copy()
    low, extent = puppet.vertices.min(0), np.ptp(puppet.vertices, axis=0).max()
    at = ((puppet.vertices - low) / extent * 63).astype(int).clip(0, 63)
    for layer in range(puppet.num_layers):
        mine = puppet.layer_of_vertex == layer
        field = np.stack([smooth_noise((64, 64), 5, hand) for _ in range(2)], -1)
        bent[mine] += hand.uniform(0, 0.05) * CHARACTER * field[at[mine, 1], at[mine, 0]]
    return bent


def _order(tree: Tree, num_layers: int, hand: np.random.Generator) -> np.ndarray:
    order = list(range(num_layers))
    if hand.random() < 0.3 and tree.edges:
        limb = tree.below(tree.edges[hand.integers(len(tree.edges))].child)
        rest = [layer for layer in order if layer not in limb]
        order = rest + sorted(limb) if hand.random() < 0.5 else sorted(limb) + rest
    return np.array(order)


def _picture(
    puppet: Puppet,
    vertices: np.ndarray,
    order: np.ndarray,
    ground: np.ndarray,
    kind: Kind,
    scale: float,
    hand: np.random.Generator,
) -> tuple[np.ndarray, Surface]:
    """RGBA (the matte in A) of one frame, and what is seen of the puppet."""
    mesh, texture = mesh_of(puppet), _redrawn(puppet, texture_at(puppet, scale), hand)
    placed, layers = torch.from_numpy(vertices[None].astype(np.float32)), torch.from_numpy(order[None])
    opacity = torch.ones(1, puppet.num_layers)
    for layer in np.flatnonzero(hand.random(puppet.num_layers) < 0.05):
        opacity[0, layer] = 0.0
    drawn = render(placed, mesh, texture, layers, (SIDE, SIDE), opacity).rgba[0].numpy()
    seen = surface(placed, mesh, texture, layers, (SIDE, SIDE), opacity)
    alpha = drawn[..., 3:]
    picture = drawn[..., :3] * 255 + (1 - alpha) * ground
    matte = alpha[..., 0] * 255
    if hand.random() < 0.3:
        _hold_something(picture, matte, puppet, hand)
    if hand.random() < (0.3 if kind == "clip" else 0.1):  # something stands in front
        x, y = hand.integers(SIDE // 4, 3 * SIDE // 4, 2)
        w, h = hand.integers(12, 60, 2)
        picture[y : y + h, x : x + w], matte[y : y + h, x : x + w] = ground[y : y + h, x : x + w], 0
        seen.triangle[0, y : y + h, x : x + w] = -1
    if kind == "clip":
        matte = _erring(matte, hand)
    picture = cv2.GaussianBlur(picture, (0, 0), hand.uniform(0.3, 1.2)) + hand.normal(
        0, hand.uniform(0, 5), picture.shape
    )
    return np.clip(np.dstack([picture, matte]) + 0.5, 0, 255).astype(np.uint8), seen


def _hold_something(picture: np.ndarray, matte: np.ndarray, puppet: Puppet, hand: np.random.Generator) -> None:
    """Draw a thing that is taken for the character's, in one of its colours, behind or in front of it."""
    opaque = puppet.atlas[puppet.atlas[..., 3] > 200][:, :3].astype(float)
    shape = np.zeros(matte.shape, np.uint8)
    centre = hand.integers(SIDE // 4, 3 * SIDE // 4, 2).tolist()
    axes = hand.integers(6, 34, 2).tolist()
    cv2.ellipse(shape, (tuple(centre), tuple(axes), float(hand.uniform(0, 180))), 255, -1)
    is_there = (shape > 0) & ((hand.random() < 0.5) | (matte < 128))
    picture[is_there], matte[is_there] = opaque[hand.integers(len(opaque))], 255


def _redrawn(puppet: Puppet, texture: Texture, hand: np.random.Generator) -> Texture:
    """Change every part's colours a little, and paint a few over in patches of another part's colour."""
    rgba = texture.rgba.numpy().copy()
    height, width = rgba.shape[:2]
    light = hand.normal(1.0, 0.05, 3)
    for layer in range(puppet.num_layers):
        uv = texture.uv.numpy()[puppet.layer_of_vertex == layer]
        (x0, y0), (x1, y1) = uv.min(0).astype(int).clip(0), np.ceil(uv.max(0)).astype(int)
        patch = rgba[y0 : min(y1, height), x0 : min(x1, width)]
        patch[..., :3] *= (light * hand.normal(1.0, 0.1)).astype(np.float32)
        if hand.random() < 0.35:
            paint = rgba[hand.integers(height), hand.integers(width)]
            colour = paint[:3] / max(float(paint[3]), 1e-3)
            share = (smooth_noise(patch.shape[:2], 6, hand) > 0.25)[..., None] * hand.uniform(0.3, 1.0)
            patch[..., :3] += share * (colour * patch[..., 3:] - patch[..., :3])
        patch[..., :3] = patch[..., :3].clip(0, patch[..., 3:])
    return texture._replace(rgba=torch.from_numpy(rgba.astype(np.float32)))


def _ground(puppet: Puppet, kind: Kind, hand: np.random.Generator) -> np.ndarray:
    """White, or a painting in which some of the puppet's own colours occur."""
    if kind == "drawings":
        return np.full((SIDE, SIDE, 3), 255.0)
    opaque = puppet.atlas[puppet.atlas[..., 3] > 200][:, :3].astype(float)
    picture = np.full((SIDE, SIDE, 3), hand.uniform(60, 230, 3))
    for _ in range(40):
        colour = opaque[hand.integers(len(opaque))] if hand.random() < 0.3 else hand.uniform(30, 240, 3)
        centre, axes = hand.integers(0, SIDE, 2).tolist(), hand.integers(8, 60, 2).tolist()
        cv2.ellipse(picture, (tuple(centre), tuple(axes), float(hand.uniform(0, 180))), tuple(colour), -1, cv2.LINE_AA)
    return np.clip(picture + 18 * smooth_noise((SIDE, SIDE), 12, hand)[..., None], 0, 255)


def _erring(matte: np.ndarray, hand: np.random.Generator) -> np.ndarray:
    """Blur the matte, forget it in blots and turn it round in a few."""
    soft = cv2.GaussianBlur(matte, (0, 0), hand.uniform(1, 4))
    wrong = smooth_noise(matte.shape, 14, hand)
    soft = np.where(wrong > 0.75, 255 - soft, soft)
    unknown = smooth_noise(matte.shape, 8, hand) > hand.uniform(-0.2, 1.2)
    return np.where(unknown, 128.0, soft)
