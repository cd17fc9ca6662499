"""Following one character through a range of frames: forwards and backwards from the frame where its box is known.

Frames are decoded a block at a time (backwards: each block is decoded forwards and walked in reverse), so memory does
not grow with the clip. What is lost is looked for again; a cut ends the walk of the tracker and the character is
looked for in the next shot. Then short gaps are bridged and the boxes are smoothed.
"""

from bisect import bisect_right

import numpy as np

from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.settings import TrackSettings
from wildpuppet.track.appearance import Appearance
from wildpuppet.track.colours import Colours, colours_of_box
from wildpuppet.track.evidence import learn_colours
from wildpuppet.track.follower import Follower, Seen, shifted
from wildpuppet.track.scene import Scene, region_around
from wildpuppet.track.smooth import bridge, fill, runs_of, share_in_picture, smooth
from wildpuppet.track.survey import samples_per_shot, survey
from wildpuppet.track.trackers import make_tracker
from wildpuppet.track.working import Pictures, Working, working_for
from wildpuppet.types import Clip, Target, Track, TrackState

# Small pictures kept in all to learn the shots' backgrounds from, about a third of a megabyte each.
SAMPLES_IN_ALL = 320
# At least this share of the user's box must lie inside the frame.
LEAST_INSIDE = 0.25


def track(clip: Clip, target: Target, settings: TrackSettings, machine: Machine) -> Track:
    """Follow the character from ``target.at`` to both ends of the range.

    The box in frame ``target.at`` is the user's, exactly. Boxes may reach beyond the frame. Lost frames carry the
    interpolated or last known box. Raises InputError where box, frame or range cannot be used.
    """
    check_target(clip, target)
    pictures = Pictures(clip, target, working_for(clip.size, target.box_video))
    working = pictures.working
    first, box = pictures[target.at], working.box_in(target.box_video)
    maker = make_tracker(settings)
    scene, colours = learn_scene(clip, target, pictures, machine)
    seen = {target.at: Seen(box, 1.0, "followed")}
    num_frames = target.end - target.start
    for walk in (pictures.forward(target.at + 1, target.end), pictures.backward(target.start, target.at)):
        follower = Follower(maker, Appearance(first, box, colours), scene, settings, first, box, working.pad)
        previous = target.at
        for index, image in walk:
            seen[index] = follower.step(image, index, shot_of(clip, index) != shot_of(clip, previous))
            previous = index
            machine.progress(num_frames + len(seen), 2 * num_frames)
    return assemble(clip, target, settings, working, seen)


def learn_scene(clip: Clip, target: Target, pictures: Pictures, machine: Machine) -> tuple[Scene, Colours]:
    """Learn the backgrounds in a first pass, and from them and the given box the character's colours."""
    working = pictures.working
    num_frames = target.end - target.start
    shot = np.array([shot_of(clip, index) for index in range(target.start, target.end)])
    inner = (working.inner(image) for _, image in pictures.forward(target.start, target.end))
    num_samples = samples_per_shot(shot, SAMPLES_IN_ALL)
    found = survey(inner, shot, lambda t: None, lambda done: machine.progress(done, 2 * num_frames), num_samples)
    scene = Scene(found, target.start)
    picture = working.inner(pictures[target.at])
    box = shifted(working.box_in(target.box_video), -working.pad)
    scene.claim(picture, target.at, box)
    region = region_around((picture.shape[1], picture.shape[0]), box, 0.0)
    if region is None:
        return scene, colours_of_box(picture, box)
    return scene, learn_colours(picture, target.at, scene, region, box)


def assemble(clip: Clip, target: Target, settings: TrackSettings, working: Working, seen: dict[int, Seen]) -> Track:
    """Put both walks together in order, bridge gaps and smooth."""
    frames = np.arange(target.start, target.end)
    shot = np.searchsorted(np.array(clip.shot_starts), frames, side="right") - 1
    walked = [seen[index] for index in range(target.start, target.end)]
    boxes = np.array([working.box_out(one.box) for one in walked])
    boxes[target.at - target.start] = target.box_video
    found: list[TrackState] = [one.state for one in walked]
    state = bridge(found, shot, share_in_picture(boxes, clip.size))
    boxes = fill(boxes, state)
    boxes = smooth(boxes, runs_of(state, shot), settings.smooth_frames, target.at - target.start)
    score = np.array([one.score for one in walked])
    return Track(frames, boxes, tuple(state), score, shot)


def shot_of(clip: Clip, index: int) -> int:
    """Number the shot that a frame belongs to."""
    return bisect_right(clip.shot_starts, index) - 1


def check_target(clip: Clip, target: Target) -> None:
    """Raise InputError unless the range, the frame and the box fit the clip."""
    if target.start >= target.end:
        raise InputError(f"frames {target.start} to {target.end}: the range is empty; give --end larger than --start")
    if target.start < 0 or target.end > clip.num_frames:
        raise InputError(
            f"frames {target.start} to {target.end}: the clip has frames 0 to {clip.num_frames}; give a range inside"
        )
    if not target.start <= target.at < target.end:
        raise InputError(
            f"--at {target.at} is outside the range {target.start} to {target.end}; give a frame from "
            f"{target.start} to {target.end - 1}"
        )
    check_box(clip.size, target.box_video)


def check_box(size: tuple[int, int], box: tuple[float, float, float, float]) -> None:
    """Raise InputError unless the box has an area and lies in the frame, at least in part."""
    x, y, w, h = box
    name = ",".join(f"{value:g}" for value in box)
    if not all(np.isfinite(box)) or w < 2 or h < 2:
        raise InputError(f"box {name}: expected x,y,w,h with w and h of at least 2 pixels, found {w:g} by {h:g}")
    inside = max(min(x + w, size[0]) - max(x, 0), 0) * max(min(y + h, size[1]) - max(y, 0), 0)
    if inside < LEAST_INSIDE * w * h:
        raise InputError(
            f"box {name}: expected a box inside the frame of {size[0]} by {size[1]} pixels, "
            f"found {inside / (w * h):.0%} of it inside; give the box in pixels of the video"
        )
