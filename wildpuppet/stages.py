"""THE LIST OF STAGES: name, version, the settings that change its answer, how to run, save and load it.

A changed answer means a changed version here, in the same commit. Each ``run`` takes the stage's inputs in order, then
its settings, then the machine; it imports what it needs when it runs, so that listing the stages costs nothing.
A stage named "search.part" makes one piece of "search", which joins them.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Int

from wildpuppet import disk
from wildpuppet.machine import Machine, Progress
from wildpuppet.settings import (
    AutoSettings,
    CropSettings,
    DistilSettings,
    FitSettings,
    OutSettings,
    ProbeSettings,
    PuppetSettings,
    SearchSettings,
    TrackSettings,
    TrainSettings,
)
from wildpuppet.types import Clip, Crops, CutOut, Fit, Followed, Hypotheses, Keyframe, Poses, Puppet, Target, Track

T = TypeVar("T")

UNKNOWN = 128
"""Matte where nothing is known."""
WriteFiles = Callable[[Path], None]


@dataclass(frozen=True)
class Stage:
    """One step from values to a value. ``settings`` names fields of ``Settings``.

    A stage with ``has_checkpoint`` is also given ``checkpoint``, the path of a file that outlives a killed run.
    """

    name: str
    version: int
    settings: tuple[str, ...]
    run: Callable[..., Any]
    save: Callable[[Any, Path], None]
    load: Callable[[Path], Any]
    has_checkpoint: bool = False


def _probe(video: Path, settings: ProbeSettings, machine: Machine) -> Clip:
    from wildpuppet.video.probe import probe

    return probe(video, settings, machine)


def _track(clip: Clip, target: Target, settings: TrackSettings, machine: Machine) -> Track:
    from wildpuppet.track.follow import track

    return track(clip, target, settings, machine)


def _crop(clip: Clip, track: Track, target: Target, settings: CropSettings, machine: Machine) -> Crops:
    from wildpuppet.crop.cut import cut

    return cut(clip, track, target, settings, machine)


def _drawings(folder: Path, settings: CropSettings, machine: Machine) -> Crops:
    from wildpuppet.crop.drawings import crops_of_drawings
    from wildpuppet.video.drawings import read_drawings

    names, images = read_drawings(folder)
    height, width = images[:1].shape[1:3]
    return crops_of_drawings(names, images, (width, height), settings)


def _automatic(clip: Clip, crops: Crops, target: Target, settings: AutoSettings, machine: Machine) -> CutOut:
    from wildpuppet.crop.warp import cut_window, inside_image
    from wildpuppet.geometry import affine
    from wildpuppet.puppet.automatic import automatic
    from wildpuppet.video.read import FrameReader

    index = target.at - target.start
    crop_from_video = affine.invert(crops.video_from_crop[index])
    matte = cut_window(crops.images[index : index + 1][0][..., 3], crop_from_video, clip.size)
    is_known = inside_image(crops.size, crop_from_video, clip.size) > 0
    known_matte = np.where(is_known, matte, UNKNOWN).astype(np.uint8)
    return automatic(FrameReader(clip).frame(target.at), known_matte, target.box_video, settings)


def _puppet(cutout: CutOut, settings: PuppetSettings, machine: Machine) -> Puppet:
    from wildpuppet.puppet.build import build

    return build(cutout, settings)


def _place(puppet: Puppet, crops: Crops, settings: SearchSettings, machine: Machine) -> Float[np.ndarray, "2 3"]:
    from wildpuppet.pose.sizing import placed_at_size

    return placed_at_size(puppet, crops, settings, machine)


def _hinges(
    puppet: Puppet, crops: Crops, placement: Float[np.ndarray, "2 3"], settings: SearchSettings, machine: Machine
) -> Puppet:
    from wildpuppet.pose.hinges import learn_hinges

    return learn_hinges(puppet, crops, placement, settings, machine)


def _search_part(
    puppet: Puppet,
    crops: Crops,
    placement: Float[np.ndarray, "2 3"],
    size: float | None,
    frames: Int[np.ndarray, "n"],
    settings: SearchSettings,
    machine: Machine,
) -> Hypotheses:
    from wildpuppet.pose.search import search

    return search(puppet, crops, placement, size, frames, settings, machine)


def _search(parts: list[Hypotheses], frames: list[int], machine: Machine) -> Hypotheses:
    """Put the pieces, which were solved in the order ``frames``, into the order of the frames."""
    order = np.argsort(np.array(frames))
    return Hypotheses(**{name: values[order] for name, values in _joined(parts).items()})


def _joined(parts: list[Hypotheses] | list[Poses]) -> dict[str, np.ndarray]:
    """Put the pieces' arrays one after the other, field by field."""
    return {field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(parts[0])}


def _keyframes_part(
    puppet: Puppet,
    crops: Crops,
    placement: Float[np.ndarray, "2 3"],
    hypotheses: Hypotheses,
    keyframe: Keyframe,
    settings: SearchSettings,
    machine: Machine,
) -> Followed:
    from wildpuppet.pose.follow import follow

    return follow(puppet, crops, placement, hypotheses, keyframe, settings, machine)


def _keyframes(hypotheses: Hypotheses, followed: list[Followed], machine: Machine) -> Hypotheses:
    from wildpuppet.pose.keyframes import joined

    return joined(hypotheses, followed)


def _choose(puppet: Puppet, crops: Crops, hypotheses: Hypotheses, settings: SearchSettings, machine: Machine) -> Poses:
    from wildpuppet.pose.choose import choose
    from wildpuppet.pose.hidden import follow_hidden

    poses = choose(puppet, crops, hypotheses, settings, machine)
    return follow_hidden(puppet, crops, hypotheses, poses, settings)


def _weigh_part(
    puppet: Puppet, crops: Crops, hypotheses: Hypotheses, frames: slice, settings: FitSettings, machine: Machine
) -> Poses:
    from wildpuppet.fit.weigh import weigh

    return weigh(puppet, crops, hypotheses, frames, settings, machine)


def _weigh(parts: list[Poses], machine: Machine) -> Poses:
    return Poses(**_joined(parts))


def _rest(puppet: Puppet, crops: Crops, placement: Float[np.ndarray, "2 3"], machine: Machine) -> Poses:
    """Stand the puppet as it was drawn in every crop: windows follow the character, so the place is the same."""
    num_frames, num_layers = len(crops.frames), puppet.num_layers
    return Poses(
        np.broadcast_to(placement, (num_frames, num_layers, 2, 3)).copy(),
        np.tile(np.arange(num_layers), (num_frames, 1)),
        np.zeros(num_frames),
        np.zeros(num_frames),
    )


def _fit_part(
    puppet: Puppet, crops: Crops, poses: Poses, frames: slice, settings: FitSettings, machine: Machine
) -> Fit:
    from wildpuppet.fit.fit import fit

    return fit(puppet, crops, poses, frames, settings, machine)


def _fit_keyed(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    frames: slice,
    keyframes: list[Keyframe],
    settings: FitSettings,
    machine: Machine,
) -> Fit:
    from wildpuppet.fit.fit import fit

    return fit(puppet, crops, poses, frames, settings, machine, keyframes)


def _fit(parts: list[Fit], machine: Machine) -> Fit:
    from wildpuppet.fit.fit import join

    return join(parts)


def _distil(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    fit: Fit,
    settings: DistilSettings,
    machine: Machine,
    checkpoint: Path,
) -> Poses:
    from wildpuppet.deform.distil import distil

    return distil(puppet, crops, poses, fit, settings, machine, checkpoint)


def _better(crops: Crops, first: Fit, second: Fit, settings: FitSettings, machine: Machine) -> Fit:
    from wildpuppet.fit.better import better

    return better(crops, first, second, settings)


def _train(
    puppet: Puppet,
    crops: Crops,
    poses: Poses,
    frames: list[int],
    train_settings: TrainSettings,
    fit_settings: FitSettings,
    machine: Machine,
    checkpoint: Path,
) -> Fit:
    """Train on ``frames`` alone, then read every frame with what was learnt."""
    from wildpuppet.deform.learn import learn
    from wildpuppet.deform.train import fit_of

    state = tuple(crops.state[index] if index in set(frames) else "lost" for index in range(len(crops.frames)))
    seen = replace(crops, state=state)
    trained = learn(puppet, seen, poses, train_settings, fit_settings, machine, checkpoint)
    return fit_of(puppet, crops, poses, trained, train_settings, machine)


def _confidence(puppet: Puppet, crops: Crops, hypotheses: Hypotheses, poses: Poses, fit: Fit, machine: Machine) -> Fit:
    from wildpuppet.fit.confidence import with_confidence

    return with_confidence(puppet, crops, hypotheses, poses, fit, machine)


def _reuse(crops: Crops, settings: CropSettings, machine: Machine) -> Int[np.ndarray, "T"]:
    from wildpuppet.crop.reused import number_reused

    return number_reused(crops, settings, machine)


def _exposure(clip: Clip | None, crops: Crops, fit: Fit, numbers: Int[np.ndarray, "T"], machine: Machine) -> WriteFiles:
    from wildpuppet.export.exposure import write_exposure

    def write(folder: Path) -> None:
        write_exposure(folder / "exposure.csv", numbers, crops, fit, clip)

    return write


def _meshes(
    clip: Clip | None, puppet: Puppet, crops: Crops, fit: Fit, settings: OutSettings, machine: Machine
) -> WriteFiles:
    from wildpuppet.export.mesh_files import write_mesh_files
    from wildpuppet.export.meshes import write_meshes

    def write(folder: Path) -> None:
        write_meshes(folder / "meshes.npz", puppet, crops, fit, clip)
        if settings.meshes != "none":
            write_mesh_files(folder / "meshes", puppet, crops, fit, settings.meshes, machine.progress)

    return write


def _preview(place: Clip | Path, puppet: Puppet, crops: Crops, fit: Fit, machine: Machine) -> WriteFiles:
    from PIL import Image

    from wildpuppet.export.preview import preview_frames
    from wildpuppet.export.sheet import sheet
    from wildpuppet.export.source import pictures, source_of
    from wildpuppet.video.write import write_preview

    def write(folder: Path) -> None:
        source = source_of(place)
        pts, time_base = source.times(fit.frames)
        shown = counted(preview_frames(pictures(source, fit.frames), puppet, crops, fit), len(pts), machine.progress)
        write_preview(folder / "preview.mp4", shown, pts, time_base)
        Image.fromarray(sheet(source_of(place).picture, puppet, crops, fit)).save(folder / "sheet.png")

    return write


def counted(items: Iterable[T], total: int, progress: Progress) -> Iterator[T]:
    """Pass items on and report how many."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, total)


PROBE = Stage("probe", 1, ("probe",), _probe, disk.save_clip, disk.load_clip)
TRACK = Stage("track", 4, ("track",), _track, disk.save_track, disk.load_track)
CROP = Stage("crop", 2, ("crop",), _crop, disk.save_crops, disk.load_crops)
DRAWINGS = Stage("drawings", 1, ("crop",), _drawings, disk.save_crops, disk.load_crops)
AUTOMATIC = Stage("automatic", 1, ("auto",), _automatic, disk.save_cutout, disk.load_cutout)
PUPPET = Stage("puppet", 3, ("puppet",), _puppet, disk.save_puppet, disk.load_puppet)
PLACE = Stage("place", 5, ("search",), _place, disk.save_placement, disk.load_placement)
HINGES = Stage("hinges", 12, ("search",), _hinges, disk.save_puppet, disk.load_puppet)
SEARCH_PART = Stage("search.part", 13, ("search",), _search_part, disk.save_hypotheses, disk.load_hypotheses)
SEARCH = Stage("search", 1, (), _search, disk.save_hypotheses, disk.load_hypotheses)
KEYFRAMES_PART = Stage(
    "keyframes.part", SEARCH_PART.version, ("search",), _keyframes_part, disk.save_followed, disk.load_followed
)
KEYFRAMES = Stage("keyframes", 1, (), _keyframes, disk.save_hypotheses, disk.load_hypotheses)
CHOOSE = Stage("choose", 5, ("search",), _choose, disk.save_poses, disk.load_poses)
WEIGH_PART = Stage("weigh.part", 2, ("fit",), _weigh_part, disk.save_poses, disk.load_poses)
WEIGH = Stage("weigh", 1, (), _weigh, disk.save_poses, disk.load_poses)
REST = Stage("rest", 1, (), _rest, disk.save_poses, disk.load_poses)
FIT_PART = Stage("fit.part", 4, ("fit",), _fit_part, disk.save_fit, disk.load_fit)
FIT_KEYED = Stage("fit.keyed", FIT_PART.version, ("fit",), _fit_keyed, disk.save_fit, disk.load_fit)
FIT = Stage("fit", 1, (), _fit, disk.save_fit, disk.load_fit)
DISTIL = Stage("distil", 1, ("distil",), _distil, disk.save_poses, disk.load_poses, has_checkpoint=True)
BETTER = Stage("better", 1, ("fit",), _better, disk.save_fit, disk.load_fit)
TRAIN = Stage("train", 2, ("train", "fit"), _train, disk.save_fit, disk.load_fit, has_checkpoint=True)
CONFIDENCE = Stage("confidence", 3, (), _confidence, disk.save_fit, disk.load_fit)
REUSE = Stage("reuse", 1, ("crop",), _reuse, disk.save_numbers, disk.load_numbers)
EXPOSURE = Stage("exposure", 1, (), _exposure, disk.save_files, disk.load_folder)
MESHES = Stage("meshes", 1, ("out",), _meshes, disk.save_files, disk.load_folder)
PREVIEW = Stage("preview", 3, (), _preview, disk.save_files, disk.load_folder)

STAGES = (
    PROBE, TRACK, CROP, DRAWINGS, AUTOMATIC, PUPPET, PLACE, HINGES, SEARCH_PART, SEARCH, KEYFRAMES_PART,
    KEYFRAMES, CHOOSE, WEIGH_PART, WEIGH, REST, FIT_PART, FIT_KEYED, FIT, DISTIL, BETTER, TRAIN, CONFIDENCE, REUSE,
    EXPOSURE, MESHES, PREVIEW,
)  # fmt: skip
NAMES = tuple(stage.name for stage in STAGES if "." not in stage.name)
"""What ``--until`` and ``--redo`` take."""
