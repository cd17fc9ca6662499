"""What `wildpuppet train` learns from (puppet, crops, fit) and how each recipe learns from it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from jaxtyping import UInt8

from wildpuppet import stages
from wildpuppet.deform.model import Model, Recipe, over_white
from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.runs import RUN, RunFolder
from wildpuppet.settings import Settings
from wildpuppet.store import digest_of
from wildpuppet.trained import CHECKPOINT, puppet_digest
from wildpuppet.types import Crops, Fit, Images, Poses, Puppet

from .reporter import Reporter

if TYPE_CHECKING:
    from .train import Arguments

Tell = Callable[[int, int, dict[str, float]], None]
RUN_OF_DRAWINGS = "run"
"""Folder in MODEL where a folder of drawings is fitted first."""


@dataclass(frozen=True, eq=False)
class Material:
    """A puppet, crops with pictures and, for our recipe, a fit; ``hold_out`` are frame numbers."""

    puppet: Puppet
    crops: Crops
    fit: Fit | None
    hold_out: tuple[int, ...]

    def identity(self, recipe: Recipe, settings: Settings) -> str:
        """Give the digest of all that a training depends on; pictures count by the windows that cut them."""
        import hashlib

        content = hashlib.blake2b(digest_size=20)
        arrays = [self.crops.video_from_crop, self.crops.drawing, self.crops.frames]
        arrays += [] if self.fit is None else [self.fit.vertices_crop, self.fit.confidence]
        for array in arrays:
            content.update(np.ascontiguousarray(array).tobytes())
        said = [recipe, msgspec.to_builtins(settings.train), msgspec.to_builtins(settings.fit)]
        return digest_of([*said, list(self.hold_out), puppet_digest(self.puppet), content.hexdigest()])


def material_of(arguments: "Arguments", settings: Settings, hold_out: list[int], reporter: Reporter) -> Material:
    """Gather what is learnt from; a folder of drawings is fitted first where our recipe needs it."""
    source = arguments.source
    if (source / RUN).is_file():
        material = _of_run(source, arguments.puppet)
    elif arguments.puppet is None:
        found = "a folder without run.json" if source.is_dir() else "a file" if source.exists() else "nothing"
        raise InputError(f"{source}: expected the OUT folder of a run, or drawings with --puppet; found {found}")
    elif arguments.recipe == "ours":
        material = _of_run(_fitted(arguments, settings, reporter), None)
    else:
        material = _of_drawings(source, arguments.puppet, settings)
    unknown = sorted(set(hold_out) - set(material.crops.frames.tolist()))
    if unknown:
        frames = material.crops.frames
        raise InputError(f"--hold-out {unknown[0]}: expected frames from {frames[0]} to {frames[-1]}")
    return replace(material, hold_out=tuple(hold_out))


def _of_run(folder: Path, puppet: Path | None) -> Material:
    from wildpuppet.recut import run_crops

    run = RunFolder(folder)
    _ = run.run
    if puppet is not None:
        check_same(puppet, run)
    return Material(run.puppet, run_crops(run), run.fit, ())


def check_same(puppet: Path, run: RunFolder) -> None:
    """Raise InputError unless the folder holds the puppet of the run."""
    from wildpuppet.puppet.build import build
    from wildpuppet.settings import settings_from

    from .request import given_cutout

    built = build(given_cutout(puppet).value, settings_from(run.run["request"]["settings"]).puppet)
    if puppet_digest(built) != puppet_digest(run.puppet):
        raise InputError(f"{puppet}: expected the puppet of the run {run.folder}, found another; leave --puppet out")


def _fitted(arguments: "Arguments", settings: Settings, reporter: Reporter) -> Path:
    """Fit the drawings by the ordinary pipeline, in MODEL/run."""
    from .fit_drawings import fit_drawings
    from .request import Request
    from .session import Options, run_pipeline

    out = arguments.out / RUN_OF_DRAWINGS
    request = Request(arguments.source, out, settings, arguments.puppet)
    options = Options(store=arguments.store, device=arguments.device, settings=settings)
    run_pipeline(fit_drawings, request, options, reporter)
    return out


def _of_drawings(folder: Path, puppet: Path, settings: Settings) -> Material:
    from wildpuppet.puppet.build import build

    from .request import given_cutout

    crops = stages.DRAWINGS.run(folder, settings.crop, Machine())
    return Material(build(given_cutout(puppet).value, settings.puppet), crops, None, ())


def trained(material: Material, recipe: Recipe, settings: Settings, machine: Machine, out: Path, tell: Tell) -> Model:
    """Train by a recipe, going on from the checkpoint in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    learn = _ours if recipe == "ours" else _as_printed
    return learn(material, settings, machine, out / CHECKPOINT, tell)


def _ours(material: Material, settings: Settings, machine: Machine, checkpoint: Path, tell: Tell) -> Model:
    from wildpuppet.deform.lesson import taught_frames
    from wildpuppet.deform.teach import taught

    assert material.fit is not None, "our recipe learns from fits"
    rows = taught_frames(material.crops, material.fit, np.array(material.hold_out, np.int64))
    return taught(
        material.puppet, material.crops, material.fit, rows, settings.train, material.hold_out, checkpoint, tell
    )


def _as_printed(material: Material, settings: Settings, machine: Machine, checkpoint: Path, tell: Tell) -> Model:
    from wildpuppet.deform.learn import learn, network_of

    crops, train = material.crops, settings.train
    held = crops.drawing[np.isin(crops.frames, material.hold_out)]
    state = tuple(
        "lost" if drawing in set(held.tolist()) else each
        for drawing, each in zip(crops.drawing.tolist(), crops.state, strict=True)
    )
    images: Images = crops.images if crops.ordered else OverWhite(crops.images)
    seen = replace(crops, state=state, images=images)
    found = learn(material.puppet, seen, standing(material), train, settings.fit, machine, checkpoint, tell)
    network = network_of(found, crops.size, train).eval()
    return Model(
        material.puppet, crops.size, network, train, "paper", not crops.ordered, material.hold_out, found.losses
    )


def standing(material: Material) -> Poses:
    """Stand the puppet at rest in every crop, as the paper starts."""
    from wildpuppet.pose.place import place

    placement = place(material.puppet, material.crops)
    poses: Poses = stages.REST.run(material.puppet, material.crops, placement, Machine())
    return poses


@dataclass(frozen=True, eq=False)
class OverWhite:
    """Drawings over white paper, the matte kept."""

    images: Images

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        pictures = self.images[index]
        return np.concatenate([over_white(pictures), pictures[..., 3:]], -1)
