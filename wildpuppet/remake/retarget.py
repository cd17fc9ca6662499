"""A run's motion on another puppet, as a run of its own in the same picture and at the same times."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from wildpuppet.errors import InputError
from wildpuppet.geometry.affine import apply, invert
from wildpuppet.motion.retarget import Match, carried_order, match_parts, retarget
from wildpuppet.puppet.build import build
from wildpuppet.puppet.folder import read_cutout
from wildpuppet.remake.posed import Posed, boxes_of
from wildpuppet.runs import RunFolder
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import Fit, Puppet

SHOWN = 12
"""Names listed in a message."""


@dataclass(frozen=True, eq=False)
class Retargeted:
    """The other puppet in motion, and which parts of the two went together by name."""

    posed: Posed
    match: Match
    pairs: tuple[tuple[str, str], ...]


def retargeted_run(run: RunFolder, to: Path, height: float = 1.0, given: Mapping[str, str] | None = None) -> Retargeted:
    """Put a run's motion on the puppet of folder ``to``.

    ``height`` is how tall it becomes, as a share of the character it follows. ``given`` pairs parts whose names
    differ: the puppet's part -> the run's. Frames that hold a drawing hold it there too. Raises InputError where no
    part has a namesake, PuppetError for a folder that is no puppet.
    """
    if not 0.0 < height < float("inf"):
        raise InputError(f"--height {height:g}: expected a number above 0, such as 1")
    follower, mover = build(read_cutout(to), PuppetSettings()), run.puppet
    _check_names(given or {}, mover, follower)
    match = match_parts(mover, follower, given)
    if not match.pairs:
        raise InputError(
            f"{to}: no part has the name of one of the run's parts ({_listed(mover.names)}); "
            f"found {_listed(follower.names)}; give --match MINE=THEIRS or rename the puppet's parts"
        )
    fit, crops = run.fit, run.crops
    animation = run.animation
    seen = np.stack([animation.vertices(t) for t in range(len(animation))])
    moved = retarget(mover, seen, crops.shot, follower, match, height)
    cropped = _held(apply(invert(crops.video_from_crop.astype(np.float64)), moved), fit)
    posed_fit = Fit(
        fit.frames, cropped, carried_order(fit.order, mover, follower, match), _trust(run, follower, match), fit.state
    )
    pairs = tuple((mover.names[a], follower.names[b]) for a, b in match.pairs)
    made_by = {
        "command": "retarget", "run": str(run.folder.absolute()), "to": str(to.absolute()), "height": height,
        "matched": [list(pair) for pair in pairs],
        "unused": list(match.unused), "at_rest": list(match.at_rest),
    }  # fmt: skip
    windows = replace(crops, box_crop=boxes_of(cropped))
    return Retargeted(Posed(follower, windows, posed_fit, run.size, run.times, made_by), match, pairs)


def _check_names(given: Mapping[str, str], mover: Puppet, follower: Puppet) -> None:
    for name, names, whose in [
        *((mine, follower.names, "the puppet's") for mine in given),
        *((theirs, mover.names, "the run's") for theirs in given.values()),
    ]:
        if name not in names:
            raise InputError(f"--match: expected one of {whose} parts ({_listed(names)}), found {name!r}")
    if len(set(given.values())) < len(given):
        raise InputError("--match: one of the run's parts is given twice; each can move one part")


def _held(cropped: Float[np.ndarray, "T V 2"], fit: Fit) -> Float[np.ndarray, "T V 2"]:
    """Repeat exactly what the run repeats exactly."""
    held = cropped.copy()
    for t in range(1, len(held)):
        if np.array_equal(fit.vertices_crop[t], fit.vertices_crop[t - 1]):
            held[t] = held[t - 1]
    return held


def _trust(run: RunFolder, follower: Puppet, match: Match) -> Float[np.ndarray, "T V"]:
    """Trust a part as much as its namesake, and a part without one as much as the whole."""
    mover, confidence = run.puppet, run.fit.confidence.astype(np.float64)
    by_layer = np.tile(confidence.mean(1)[:, None], (1, follower.num_layers))
    for mine, theirs in match.pairs:
        by_layer[:, theirs] = confidence[:, mover.layer_of_vertex == mine].mean(1)
    return np.asarray(by_layer[:, follower.layer_of_vertex])


def _listed(names: tuple[str, ...]) -> str:
    more = f", and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
