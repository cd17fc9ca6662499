"""OpenTimelineIO: NAME.otio, one track with a clip per shot, the character's absences as markers on them.

Clips refer to frames of the source clip: value / rate is the time from its frame 0 where the rate is even, and from the
run's first frame where it is not. The media itself is a missing reference under the run's name: relink it to the clip
or to one of the other exports. Written after the published schemas; every frame's place is in the manifest.
"""

import json
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.otio."""
    first = options.first_of(int(animation.frames[0]))
    bounds = [*animation.shot_starts, len(animation)]
    clips = [_clip(animation, number, span, first) for number, span in enumerate(pairwise(bounds), 1)]
    track = {"OTIO_SCHEMA": "Track.1", "name": "shots", "kind": "Video", "children": clips}
    stack = {"OTIO_SCHEMA": "Stack.1", "name": "tracks", "children": [track]}
    begin = _time(animation, 0, 0)
    timeline = {"OTIO_SCHEMA": "Timeline.1", "name": animation.name, "global_start_time": begin, "tracks": stack}
    path = folder / f"{file_names([animation.name])[0]}.otio"
    path.write_text(json.dumps(timeline, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    progress(1, 1)
    left_out = ("pictures, meshes, joints, held drawings: this is the cut",)
    return Manifest("none: times only", "none: times only", first, 1.0, left_out)


def _value(animation: Animation, index: int, first: int) -> float:
    """Count frames of the nominal rate up to a frame; ``index`` may be the end."""
    timing = animation.timing
    seconds = timing.end_seconds() if index == len(animation) else timing.seconds(index)
    return float(first + seconds * timing.rate)


def _time(animation: Animation, index: int, first: int) -> dict[str, Any]:
    rate = float(animation.timing.rate)
    return {"OTIO_SCHEMA": "RationalTime.1", "rate": rate, "value": _value(animation, index, first)}


def _range(animation: Animation, span: tuple[int, int], first: int) -> dict[str, Any]:
    begin, end = (_value(animation, index, first) for index in span)
    duration = {"OTIO_SCHEMA": "RationalTime.1", "rate": float(animation.timing.rate), "value": end - begin}
    return {"OTIO_SCHEMA": "TimeRange.1", "start_time": _time(animation, span[0], first), "duration": duration}


def _clip(animation: Animation, number: int, span: tuple[int, int], first: int) -> dict[str, Any]:
    whole = _range(animation, (0, len(animation)), first)
    media = {"OTIO_SCHEMA": "MissingReference.1", "name": animation.name, "available_range": whole}
    lost = [
        {"OTIO_SCHEMA": "Marker.2", "name": "character lost", "color": "RED", "marked_range": gone}
        for gone in (_range(animation, gap, first) for gap in _gaps(animation, span))
    ]
    frames = [int(animation.frames[span[0]]), int(animation.frames[span[1] - 1])]
    return {
        "OTIO_SCHEMA": "Clip.2",
        "name": f"shot {number}",
        "source_range": _range(animation, span, first),
        "markers": lost,
        "active_media_reference_key": "DEFAULT_MEDIA",
        "media_references": {"DEFAULT_MEDIA": media},
        "metadata": {"wildpuppet": {"first_frame": frames[0], "last_frame": frames[1]}},
    }


def _gaps(animation: Animation, span: tuple[int, int]) -> list[tuple[int, int]]:
    """Spans of a shot in which the character is lost."""
    runs = [list(run) for seen, run in groupby(range(*span), lambda t: bool(animation.is_visible[t])) if not seen]
    return [(run[0], run[-1] + 1) for run in runs]
