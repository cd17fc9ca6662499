"""Painting a finished run: finds its clip or drawings, reads the person's pictures, draws the frames anew."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from wildpuppet.errors import InputError
from wildpuppet.export.source import source_of
from wildpuppet.machine import Progress, silent
from wildpuppet.paint.behind import background_of_run
from wildpuppet.paint.paint import Job, Over, check_out, paint
from wildpuppet.paint.reading import Origin, read_edit, read_given
from wildpuppet.recut import clip_of_run, is_clip, place_of_run
from wildpuppet.runs import PUPPET, RunFolder
from wildpuppet.types import Clip


def paint_run(
    run: RunFolder,
    texture: Path,
    out: Path,
    over: Over = "original",
    source: Path | None = None,
    progress: Progress = silent,
) -> Path:
    """Draw every frame of a run anew with the edited ``texture``, into OUT.

    ``over``: "original" (the run's own frames; only what was painted changes), "plate" (the whole puppet over the
    background without the character) or "none" (the puppet alone, transparent around it). ``source`` is where the clip
    or the drawings lie now, when they were moved; "none" needs them only for a texture painted on a frame.

    Raises InputError for what does not fit, before anything is drawn.
    """
    check_out(out)
    if not len(run.animation):
        raise InputError(f"{run.folder}: expected a run with frames, found none; run it on a longer range")
    place = None if over == "none" else place_of_run(run, source)
    edit = read_edit(texture, run.puppet, Origin(read_given(_given(run)), lambda: _reference(run, place or source)))
    if place is None:
        return paint(Job(run.animation, edit, over), out, progress)
    needs_background = over == "plate" or edit.erases
    behind = background_of_run(run, place) if needs_background else None
    return paint(Job(run.animation, edit, over, source_of(place), behind), out, progress)


def _given(run: RunFolder) -> Path | None:
    """Find the puppet folder of a run: the one it was given, or the one it made."""
    named = run.run["request"]["puppet"]
    return run.folder / PUPPET if named is None else Path(named)


def _reference(run: RunFolder, place: Clip | Path | None) -> UInt8[np.ndarray, "H W 3"] | None:
    """Read the frame that the puppet was drawn from; None where there is none. ``place``: the clip, or where it is."""
    number = run.puppet.reference
    if number is None or not is_clip(run) or run.puppet.canvas != run.size:
        return None
    clip = place if isinstance(place, Clip) else clip_of_run(run, place)
    return source_of(clip).picture(number) if 0 <= number < clip.num_frames else None
