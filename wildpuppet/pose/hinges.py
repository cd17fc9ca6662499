"""Where the hinges really are, learnt from the character's own motion.

A joint guessed from the overlap of two parts is off by 5 to 15 % of the character, and then every turn pulls a limb off
its place. Two parts that turn against each other show their hinge: the one point of the drawn pose that both carry to
the same place in every drawing. A sample of drawings is searched, every hinge moves to that point (robustly, held to
where it was), and the sample is searched again with better hinges.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.machine import Machine
from wildpuppet.pose.pieces import pieces_of
from wildpuppet.pose.place import rest_box
from wildpuppet.pose.search import search
from wildpuppet.pose.tree import joint_points, part_areas
from wildpuppet.puppet.joints import attach
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Puppet

ROUNDS = 2
"""How often the sample is searched and the hinges are moved."""
GAP_SHARE = 0.03
"""Gap of a hinge, as a share of the character's larger side, beyond which a drawing says less and less."""
TRUST_SHARE = 0.2
"""How far a hinge moves readily, as a share of the smaller part's size (the root of its area)."""
TRUST = 2.0
"""How many drawings the guessed place is worth."""
ITERATIONS = 20


def learn_hinges(
    puppet: Puppet,
    crops: Crops,
    placement: Float[np.ndarray, "2 3"],
    settings: SearchSettings,
    machine: Machine,
) -> Puppet:
    """Move the puppet's hinges to where a sample of ``settings.hinge_drawings`` drawings shows them.

    ``placement`` as in ``search``. Fewer than three drawings say nothing: the puppet comes back as it is.
    """
    sample = sample_of(crops, settings.hinge_drawings)
    if len(sample) < 3 or not len(puppet.joint_layers):
        return puppet
    total = ROUNDS * len(sample)
    for done in range(ROUNDS):

        def progress(part: int, _: int, before: int = done * len(sample)) -> None:
            machine.progress(before + part, total)

        found = search(puppet, crops, placement, None, sample, settings, replace(machine, progress=progress))
        places = hinge_places(pieces_of(puppet).puppet, found.crop_from_canvas[:, 0])
        puppet = with_hinges(puppet, places[: len(puppet.joint_layers)])  # bends stay in the middle of their parts
    return puppet


def sample_of(crops: Crops, count: int) -> Int[np.ndarray, "n"]:
    """Choose ``count`` frames of distinct drawings, evenly over those in which the character was not lost."""
    _, first = np.unique(crops.drawing, return_index=True)
    seen = np.array([index for index in np.sort(first) if crops.state[index] != "lost"], np.int64)
    return seen[np.unique(np.linspace(0, len(seen) - 1, min(count, len(seen))).round().astype(np.int64))]


def hinge_places(puppet: Puppet, maps: Float[np.ndarray, "T L 2 3"]) -> Float[np.ndarray, "J 2"]:
    """Find each joint's point of the drawn pose that its two parts' ``maps`` carry to one place, canvas pixels.

    Minimises the sum over drawings of Geman and McClure's function of the gap, plus the hold to the present place, by
    iterated reweighting.
    """
    size = float(rest_box(puppet)[2:].max())
    spread = np.sqrt(part_areas(puppet))
    guesses = joint_points(puppet).mean(1)
    places = [
        _meeting_point(maps[:, a], maps[:, b], guess, GAP_SHARE * size, TRUST_SHARE * min(spread[a], spread[b]))
        for (a, b), guess in zip(puppet.joint_layers, guesses, strict=True)
    ]
    return np.array(places).reshape(-1, 2)


def _meeting_point(
    first: Float[np.ndarray, "T 2 3"],
    second: Float[np.ndarray, "T 2 3"],
    guess: Float[np.ndarray, "2"],
    gap_scale: float,
    move_scale: float,
) -> Float[np.ndarray, "2"]:
    size = np.sqrt(np.abs(np.linalg.det(first[:, :, :2])))[:, None, None]
    difference = (first - second) / size
    turn, shift = difference[:, :, :2], difference[:, :, 2]
    hold = TRUST / move_scale**2
    place = guess
    for _ in range(ITERATIONS):
        gap = turn @ place + shift
        weight = (1 + (gap**2).sum(1) / gap_scale**2) ** -2 / gap_scale**2
        normal = np.einsum("t,tij,tik->jk", weight, turn, turn) + hold * np.eye(2)
        place = np.linalg.solve(normal, hold * guess - np.einsum("t,tij,ti->j", weight, turn, shift))
    return place


def with_hinges(puppet: Puppet, places: Float[np.ndarray, "J 2"]) -> Puppet:
    """Tie every joint to its two parts' meshes at a new place of the drawn pose (canvas pixels)."""
    vertices, weights = puppet.joint_vertices.copy(), puppet.joint_weights.copy()
    for joint, place in enumerate(places):
        for side, layer in enumerate(puppet.joint_layers[joint]):
            triangles = puppet.triangles[puppet.layer_of_triangle == layer]
            vertices[joint, side], weights[joint, side] = attach(place, puppet.vertices, triangles)
    return replace(puppet, joint_vertices=vertices, joint_weights=weights)
