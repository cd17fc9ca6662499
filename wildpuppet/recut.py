"""Crops with pictures of a finished run, cut anew from the clip or the drawings that it was made from; no store needed.

    crops = run_crops(open_run("out/clip"))                     # rgb exactly as the run saw it, matte 128 (unknown)
    crops = run_crops(open_run("out/clip"), with_matte=True)    # the matte too; costs one pass over the clip

The source must be the very files of the run: their digest is compared with the one in run.json.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from wildpuppet.crop.cut import WindowImages
from wildpuppet.crop.drawings import DrawingImages
from wildpuppet.crop.matte import Matter
from wildpuppet.crop.plate import learn_plates, plate_scale
from wildpuppet.crop.window import Windows
from wildpuppet.errors import InputError
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.runs import RunFolder
from wildpuppet.settings import settings_from
from wildpuppet.store import digest_of, digest_of_file
from wildpuppet.types import Clip, Crops, Track
from wildpuppet.video.drawings import read_drawings
from wildpuppet.video.probe import probe


def run_crops(
    run: RunFolder, source: Path | None = None, with_matte: bool = False, machine: Machine | None = None
) -> Crops:
    """Give a run's crops with their pictures, read when they are sliced; consecutive slices cost one pass.

    ``source`` is where the clip or the folder of drawings lies now, when it was moved. Drawings always have their
    matte. ``with_matte`` has the background plates of a clip learnt anew, as the run did; without it, alpha is 128
    (unknown) everywhere. Raises InputError where the source is gone or is another than the run's.
    """
    place = source_of_run(run, source)
    if is_clip(run):
        return _crops_of_clip(run, place, with_matte, machine or Machine())
    _, images = read_drawings(place)
    crops = run.crops
    return replace(crops, images=DrawingImages(images, crops.video_from_crop[0], crops.size))


def is_clip(run: RunFolder) -> bool:
    """Tell a run on a clip from one on a folder of drawings."""
    return run.run["request"]["box_video"] is not None


def source_of_run(run: RunFolder, source: Path | None = None) -> Path:
    """Find the clip or the folder of drawings of a run; raises InputError where it is gone or has changed."""
    made_by = run.run["request"].get("made_by")
    if made_by:
        raise InputError(f"{run.folder}: made by `wildpuppet {made_by['command']}`, no pictures lie behind it")
    place = source or Path(run.run["request"]["source"])
    kind = "clip" if is_clip(run) else "folder of drawings"
    if not place.exists():
        raise InputError(f"{place}: expected the {kind} of the run {run.folder}, found nothing; put it back")
    if _digest_of_source(place, is_clip(run)) != _digest_of_run(run):
        raise InputError(f"{place}: expected the {kind} of the run {run.folder}, found another; run again on this one")
    return place


def clip_of_run(run: RunFolder, source: Path | None = None, machine: Machine | None = None) -> Clip:
    """Read the frame table of a run's clip anew (one decoding pass)."""
    settings = settings_from(run.run["request"]["settings"]).probe
    return probe(source_of_run(run, source), settings, machine or Machine())


def place_of_run(run: RunFolder, source: Path | None = None, machine: Machine | None = None) -> Clip | Path:
    """Find what a run's pictures are read from: its clip (one decoding pass) or its folder of drawings."""
    return clip_of_run(run, source, machine) if is_clip(run) else source_of_run(run, source)


def _digest_of_source(place: Path, is_file: bool) -> object:
    if is_file:
        return digest_of_file(place) if place.is_file() else None
    names, _ = read_drawings(place)
    return ["folder", digest_of({name: digest_of_file(place / name) for name in names})]


def _digest_of_run(run: RunFolder) -> object:
    """The digest of the source that run.json holds: what its first stage was given."""
    stage, name = ("probe", "video") if is_clip(run) else ("drawings", "folder")
    return next((used["inputs"].get(name) for used in run.run["stages"] if used["stage"] == stage), None)


def _crops_of_clip(run: RunFolder, place: Path, with_matte: bool, machine: Machine) -> Crops:
    crops, clip = run.crops, clip_of_run(run, place, machine)
    track = track_of(crops)
    matter = None
    if with_matte:
        scale = plate_scale(clip, track, 1.0 / float(crops.video_from_crop[crops.reference or 0, 0, 0]))
        survey, _ = learn_plates(clip, track, scale, machine)
        matter = Matter(track, survey, scale)
    windows = Windows(crops.size, crops.video_from_crop)
    return replace(crops, images=WindowImages(clip, track, windows, matter))


def track_of(crops: Crops) -> Track:
    """Give the boxes that crops were cut around; what the tracker's score was is not kept (1)."""
    corners = affine.apply(crops.video_from_crop, crops.box_crop[:, None, :2])[:, 0]
    sides = crops.box_crop[:, 2:] * crops.video_from_crop[:, 0, 0, None]
    return Track(crops.frames, np.concatenate([corners, sides], 1), crops.state, np.ones(len(crops.frames)), crops.shot)
