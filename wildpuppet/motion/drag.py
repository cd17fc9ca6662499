"""Drag a pose by handles so that the rest follows as it did in known poses.

Where a code may go is read off the known poses (a run's own frames), with weights that fall with the distance from the
pose that is dragged and with how far the pose's own points are from the targets. Both scales grow with the drag itself
(r, the root mean square of the handles' ways): a small drag looks at near poses, a large one further away, and a drag
of nothing stays. With w_k the weights, x_k the known codes:

    centre = sum_k w_k x_k,   directions = sqrt(w'_k) (x_k - centre),   w' as w, but never narrower than the poses lie

Then Gauss-Newton over the directions (``fit/pull_codes.py``). A drag to where no known pose leads turns parts about
their hinges. The last pixels are met over the vertices (``fit/pull_vertices.settle``), so that handles are exact.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from wildpuppet.fit.handles import Handles, deform_energy
from wildpuppet.fit.pull_codes import Decoder, Subspace, decode, decode_with_jacobian, pull_codes
from wildpuppet.fit.pull_vertices import settle
from wildpuppet.types import Puppet

NEAR_POSE = 0.2
"""How far, in drags, a known pose may be from the dragged one (per vertex) to count by half or so."""
NEAR_TARGET = 0.5
"""The same for how far its points are from the targets."""
REACH = 2.0
"""The directions see at least this far, in typical distances between neighbouring poses."""
SPREAD = 0.3
"""How exactly the known poses are believed, in the same distances."""
KNOWN_RIGID = 0.1
"""Weight of L_reg among known poses. Their parts bend as they were drawn; the paper's 25 would straighten them."""
DOUBT = 0.03
"""A known pose counts for a third where its confidence is this much below that of the dragged one."""
FAR = 0.15
"""A handle that known poses leave this far from its target, of [-1, 1], is met by turning parts."""
TURNING, MOST_TURN, TURNING_SPREAD = 0.01, 0.5, 0.003
"""What a part turns by at the cost 1: so that the puppet moves by this much (of [-1, 1], root mean square over all
vertices), by so many radians at most, beside how exactly handles are met. A hand turns before a leg."""
MOST_DIRECTIONS = 48
LONE_SPACING = 0.01
"""Typical distance, as a share of the pose's size, where there are not two poses to measure it on."""


@dataclass(frozen=True, eq=False)
class Known:
    """K poses that are known, pixels, and their codes; ``turnings`` are directions in which a code turns one part.

    Decoders that know no parts have no ``turnings``: (0, Z). ``trust`` is each pose's confidence, 0..1, where
    they are not all alike.
    """

    vertices: Float[np.ndarray, "K V 2"]
    codes: Float[np.ndarray, "K Z"]
    turnings: Float[np.ndarray, "L Z"]
    trust: Float[np.ndarray, "K"] | None = None


@dataclass(frozen=True, eq=False)
class Dragged:
    """The answer: ``vertices`` meet the handles, ``decoded`` are the code's own (pixels)."""

    vertices: Float[np.ndarray, "V 2"]
    decoded: Float[np.ndarray, "V 2"]
    code: Float[np.ndarray, "Z"]


def drag(
    puppet: Puppet, decoder: Decoder, known: Known, start: int, handles: Handles, unit: float,
    rigid: float = KNOWN_RIGID,
) -> Dragged:  # fmt: skip
    """Drag the known pose ``start`` by its handles. ``unit`` is 2 over the crop's larger side.

    What the decoder misses of the start is kept.
    """
    from_pose = known.vertices[start].astype(np.float64)
    left = from_pose - decode(decoder, known.codes[start])
    kept = replace(handles, targets=handles.targets - handles.points(left))
    space = subspace(known, start, handles, unit)
    energy = deform_energy(puppet, decode(decoder, space.centre), kept, unit, rigid)
    code = pull_codes(energy, decoder, space)
    if len(known.turnings) and kept.missing(decode(decoder, code)).max() * unit > FAR:
        energy = deform_energy(puppet, decode(decoder, code), kept, unit, rigid)
        code = pull_codes(energy, decoder, turning(decoder, code, known, unit))
    decoded = decode(decoder, code) + left
    return Dragged(settle(deform_energy(puppet, decoded, handles, unit), decoded), decoded, code)


def subspace(known: Known, start: int, handles: Handles, unit: float) -> Subspace:
    """Say where the answer is looked for."""
    spacing = typical_spacing(known.vertices) * unit
    pose, target = _distances(known, start, handles, unit)
    way, least = float(target[start]), (REACH * spacing) ** 2
    trust = np.ones(len(known.codes)) if known.trust is None else known.trust
    doubt = np.maximum(trust[start] - trust, 0.0) / DOUBT
    near = _weights(pose, target, doubt, NEAR_POSE**2 * way, NEAR_TARGET**2 * way)
    wide = _weights(pose, target, doubt, NEAR_POSE**2 * way + least, NEAR_TARGET**2 * way + least)
    centre = near @ known.codes
    used = np.argsort(-wide, kind="stable")[:MOST_DIRECTIONS]
    directions = np.sqrt(wide[used])[:, None] * (known.codes[used] - centre)
    return Subspace(centre, directions, SPREAD * spacing)


def turning(decoder: Decoder, code: Float[np.ndarray, "Z"], known: Known, unit: float) -> Subspace:
    """Let every part turn, the more readily the less of the puppet goes with it."""
    _, moved = decode_with_jacobian(decoder, code, known.turnings)
    swing = np.sqrt((moved**2).sum(1).mean(0)) * unit
    radians = np.minimum(TURNING / np.maximum(swing, np.finfo(float).tiny), MOST_TURN)
    return Subspace(code, radians[:, None] * known.turnings, TURNING_SPREAD)


def typical_spacing(vertices: Float[np.ndarray, "K V 2"]) -> float:
    """Measure the median distance (root mean square over vertices, pixels) from a pose to the one nearest to it."""
    if len(vertices) < 2:
        return LONE_SPACING * float(np.ptp(vertices, axis=(0, 1)).max())
    flat = vertices.reshape(len(vertices), -1).astype(np.float64)
    flat = flat - flat.mean(0)
    squares = (flat**2).sum(1)
    apart = squares[:, None] + squares[None] - 2.0 * flat @ flat.T
    np.fill_diagonal(apart, np.inf)
    return float(np.median(np.sqrt(np.maximum(apart.min(1), 0.0) / vertices.shape[1])))


def _distances(
    known: Known, start: int, handles: Handles, unit: float
) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
    """Mean squared distance of each known pose from the start, and of its points from the targets; of [-1, 1]."""
    pose = ((known.vertices - known.vertices[start]) ** 2).sum(-1).mean(-1)
    target = ((handles.points(known.vertices) - handles.targets) ** 2).sum(-1).mean(-1)
    return pose * unit**2, target * unit**2


def _weights(
    pose: Float[np.ndarray, "K"],
    target: Float[np.ndarray, "K"],
    doubt: Float[np.ndarray, "K"],
    pose_scale: float,
    target_scale: float,
) -> Float[np.ndarray, "K"]:
    tiny = 1e-12
    logarithm = -doubt - pose / (2.0 * pose_scale + tiny) - target / (2.0 * target_scale + tiny)
    weights = np.exp(logarithm - logarithm.max())
    return np.asarray(weights / weights.sum())
