"""From crops and a puppet to a fit: hinges, search, choose, weigh, fit, confidence.

Long stages go in chunks that are kept one by one.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from jaxtyping import Int

from wildpuppet import stages
from wildpuppet.store import Kept, digest_of, given
from wildpuppet.types import Crops, Fit, Hypotheses, Keyframe, Poses, Puppet

from .keeper import Keeper

CHUNK = 16
"""Frames per kept chunk: what a killed run can lose of a long stage."""


Keyframes = Mapping[int, Kept[Keyframe]]
"""What a person fixed, by the frame's index."""
NO_KEYFRAMES: Keyframes = {}


@dataclass(frozen=True)
class Frames:
    """How many frames there are and where their search starts (``reference``, an index; None for unordered ones).

    ``test`` frames are fitted but never trained on.
    """

    number: int
    reference: int | None
    test: list[int] = field(default_factory=list)

    def walks(self) -> list[list[int]]:
        """Give the orders in which frames are searched: from the reference to the end, and back to the start."""
        first = self.reference or 0
        walks = [list(range(first, self.number)), list(range(first - 1, -1, -1))]
        return [walk for walk in walks if walk]


def with_learnt_hinges(keeper: Keeper, puppet: Kept[Puppet], crops: Kept[Crops]) -> Kept[Puppet]:
    """Let the drawings show where the hinges are, where there is a search to learn from."""
    if not (keeper.settings.search.enabled and keeper.settings.search.hinge_drawings):
        return puppet
    placement = keeper.keep(stages.PLACE, puppet=puppet, crops=crops)
    return keeper.keep(stages.HINGES, puppet=puppet, crops=crops, placement=placement)


def fit_frames(
    keeper: Keeper, puppet: Kept[Puppet], crops: Kept[Crops], frames: Frames, keyframes: Keyframes = NO_KEYFRAMES
) -> Kept[Fit]:
    """Fit the puppet to every frame and say how far it can be trusted."""
    placement = keeper.keep(stages.PLACE, puppet=puppet, crops=crops)
    hypotheses, poses = find_poses(keeper, puppet, crops, placement, frames, keyframes)
    if keeper.settings.fit.method == "network":
        training = [index for index in range(frames.number) if index not in set(frames.test)]
        fit = keeper.keep(stages.TRAIN, puppet=puppet, crops=crops, poses=poses, frames=given(training))
    else:
        fit = descend(keeper, puppet, crops, poses, frames, keyframes)
    trusted = keeper.keep(stages.CONFIDENCE, puppet=puppet, crops=crops, hypotheses=hypotheses, poses=poses, fit=fit)
    if keeper.settings.distil.iterations and keeper.settings.fit.method == "descent" and crops.value.ordered:
        read = keeper.keep(stages.DISTIL, puppet=puppet, crops=crops, poses=poses, fit=trusted)
        again = descend(keeper, puppet, crops, read, frames, keyframes)
        fit = keeper.keep(stages.BETTER, crops=crops, first=fit, second=again)
        poses = fit.derived("its poses", partial(_poses_of, puppet.value))
        trusted = keeper.keep(
            stages.CONFIDENCE, puppet=puppet, crops=crops, hypotheses=hypotheses, poses=poses, fit=fit
        )
    return trusted


def _poses_of(puppet: Puppet, fit: Fit) -> Poses:
    from wildpuppet.deform.distil import as_poses

    nothing = np.zeros(len(fit.frames))
    return Poses(as_poses(puppet, fit.vertices_crop), fit.order, nothing, nothing)


def find_poses(
    keeper: Keeper,
    puppet: Kept[Puppet],
    crops: Kept[Crops],
    placement: Kept[Any],
    frames: Frames,
    keyframes: Keyframes = NO_KEYFRAMES,
) -> tuple[Kept[Hypotheses], Kept[Poses]]:
    """Search every frame's pose and choose over time; with the search off, the placed rest pose everywhere."""
    if not keeper.settings.search.enabled:
        poses = keeper.keep(stages.REST, puppet=puppet, crops=crops, placement=placement)
        return poses.derived("alone", _alone), poses
    hypotheses = search(keeper, puppet, crops, placement, frames)
    if keyframes:
        hypotheses = follow_keyframes(keeper, puppet, crops, placement, hypotheses, keyframes)
    poses = keeper.keep(stages.CHOOSE, puppet=puppet, crops=crops, hypotheses=hypotheses)
    if keeper.settings.fit.overrule and keeper.settings.fit.method == "descent" and not crops.value.ordered:
        poses = weigh(keeper, puppet, crops, hypotheses, frames)
    return hypotheses, poses


def weigh(
    keeper: Keeper, puppet: Kept[Puppet], crops: Kept[Crops], hypotheses: Kept[Hypotheses], frames: Frames
) -> Kept[Poses]:
    """Let the fit's energy choose each drawing's hypothesis, chunk by chunk."""
    from wildpuppet.fit.spans import spans_of

    with keeper.step(stages.WEIGH.name, frames.number):
        parts = [
            keeper.keep(
                stages.WEIGH_PART, weight=span.stop - span.start, puppet=puppet, crops=crops, hypotheses=hypotheses,
                frames=given(span, [span.start, span.stop]),
            )
            for span in spans_of(crops.value.drawing, CHUNK)
        ]  # fmt: skip
        return keeper.keep(stages.WEIGH, weight=0.0, parts=parts)


def _alone(poses: Poses) -> Hypotheses:
    """Take poses that nothing was weighed against for the only hypotheses."""
    return Hypotheses(poses.crop_from_canvas[:, None], poses.order[:, None], poses.cost[:, None])


def search(
    keeper: Keeper, puppet: Kept[Puppet], crops: Kept[Crops], placement: Kept[Any], frames: Frames
) -> Kept[Hypotheses]:
    """Walk from the reference both ways; each chunk starts from the size that the one before ended with.

    Chunks end with their shot; another shot's first starts from the size that is expected there.
    """
    shots, parts = crops.value.shot, list[Kept[Any]]()
    order: list[int] = []
    with keeper.step(stages.SEARCH.name, frames.number):
        for walk in frames.walks():
            size: Kept[Any] = placement.derived("size", _size_of)
            last = frames.reference or 0
            for chunk in _chunks(walk, shots):
                if shots[chunk[0]] != shots[last]:
                    size = given(None, "as expected")
                indices = given(np.array(chunk), chunk)
                part = keeper.keep(
                    stages.SEARCH_PART, weight=len(chunk), puppet=puppet, crops=crops, placement=placement, size=size,
                    frames=indices,
                )  # fmt: skip
                size = part.derived("size_after", _size_after)
                parts.append(part)
                order += chunk
                last = chunk[-1]
        return keeper.keep(stages.SEARCH, weight=0.0, parts=parts, frames=given(order))


def follow_keyframes(
    keeper: Keeper,
    puppet: Kept[Puppet],
    crops: Kept[Crops],
    placement: Kept[Any],
    hypotheses: Kept[Hypotheses],
    keyframes: Keyframes,
) -> Kept[Hypotheses]:
    """Let the keyframes' poses stand alone in their frames, and beside what was found in the frames around them."""
    with keeper.step(stages.KEYFRAMES.name, len(keyframes)):
        parts = [
            keeper.keep(
                stages.KEYFRAMES_PART, puppet=puppet, crops=crops, placement=placement, hypotheses=hypotheses,
                keyframe=keyframe,
            )
            for keyframe in keyframes.values()
        ]  # fmt: skip
        return keeper.keep(stages.KEYFRAMES, weight=0.0, hypotheses=hypotheses, parts=parts)


def _size_of(placement: Any) -> float:
    from wildpuppet.pose.place import size_of

    return size_of(placement)


def _size_after(hypotheses: Hypotheses) -> float:
    from wildpuppet.pose.search import size_after

    return size_after(hypotheses)


def descend(
    keeper: Keeper,
    puppet: Kept[Puppet],
    crops: Kept[Crops],
    poses: Kept[Poses],
    frames: Frames,
    keyframes: Keyframes = NO_KEYFRAMES,
) -> Kept[Fit]:
    """Descend chunk by chunk, each of whole held drawings, then join; a chunk is known by its own frames' poses."""
    from wildpuppet.fit.spans import spans_of

    parts: list[Kept[Any]] = []
    with keeper.step(stages.FIT.name, frames.number):
        for span in spans_of(crops.value.drawing, CHUNK):
            indices, weight = given(span, [span.start, span.stop]), span.stop - span.start
            fixed = [keyframe for index, keyframe in keyframes.items() if span.start <= index < span.stop]
            inputs: dict[str, Kept[Any]] = {
                "puppet": puppet,
                "crops": crops,
                "poses": poses_in(poses, span),
                "frames": indices,
            }
            if fixed:
                parts.append(keeper.keep(stages.FIT_KEYED, weight=weight, **inputs, keyframes=fixed))
            else:
                parts.append(keeper.keep(stages.FIT_PART, weight=weight, **inputs))
        return keeper.keep(stages.FIT, weight=0.0, parts=parts)


def poses_in(poses: Kept[Poses], span: slice) -> Kept[Poses]:
    """Know the poses by those of ``span``: where others change, its fit stays."""
    if poses.digest is None:
        return poses
    arrays = [np.ascontiguousarray(getattr(poses.value, name)[span]) for name in ("crop_from_canvas", "order")]
    return given(poses.value, digest_of([[str(array.dtype), array.shape, array.tobytes().hex()] for array in arrays]))


def _chunks(indices: list[int], shots: Int[np.ndarray, "T"]) -> Iterator[list[int]]:
    for _, group in groupby(indices, lambda index: int(shots[index])):
        of_shot = list(group)
        for first in range(0, len(of_shot), CHUNK):
            yield of_shot[first : first + CHUNK]
