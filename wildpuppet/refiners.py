"""The REFINER folder: a finished refinement on disk, with the puppet and the drawings that it knows.

refiner.safetensors   the generator's weights (none for the method "texture")
drawings.mkv          the drawings, premultiplied RGBA, lossless
poses.npz             where the puppet is in each
puppet.npz            the built puppet, so that a refiner can be used alone
refiner.json          schema, digest of the puppet, settings, weights of the drawings, frames held out, losses in short

refiner.json is written last and without times: a training that is done again gives the same bytes.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import msgspec
from safetensors.torch import save_file

from wildpuppet import disk
from wildpuppet.deform.checkpoint import read_tensors
from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.recut import run_crops
from wildpuppet.refine.examples import Examples
from wildpuppet.refine.learn import Tell, new_generator, quiet
from wildpuppet.refine.network import Generator
from wildpuppet.refine.refiner import Refiner, refiner_of
from wildpuppet.refine.texture import Weights
from wildpuppet.runs import RunFolder
from wildpuppet.settings import RefineSettings
from wildpuppet.store import digest_of
from wildpuppet.trained import (
    CHECKPOINT,
    check_only,
    in_short,
    is_made_from,
    puppet_digest,
    read_description,
    replaced_files,
    write_description,
)
from wildpuppet.types import Puppet
from wildpuppet.video.lossless import VideoImages, write_lossless

FORMAT = "wildpuppet.refiner"
SCHEMA = f"{FORMAT}/1"
DESCRIPTION = "refiner.json"
WEIGHTS = "refiner.safetensors"
DRAWINGS = "drawings.mkv"
POSES = "poses.npz"
POSES_SCHEMA = "wildpuppet.refiner.poses/1"
OURS = (DESCRIPTION, WEIGHTS, DRAWINGS, POSES, CHECKPOINT, "puppet.npz")


def refiner_of_run(
    run: RunFolder,
    settings: RefineSettings,
    machine: Machine,
    hold_out: Collection[int] = (),
    folder: Path | None = None,
    source: Path | None = None,
    tell: Tell = quiet,
) -> Refiner:
    """Learn the look of a run's drawings, all but those of the frames ``hold_out``.

    With ``folder`` the refiner is kept there: one that was made from just the same is read back, and an unfinished
    training is gone on from. ``source`` is where the clip or the drawings lie now, when they were moved. Raises
    InputError for a folder with other files, frames that are none of the run's, and too few drawings.
    """
    held_out = tuple(sorted(set(hold_out)))
    if folder is not None:
        check_refiner_out(folder)
        kept = kept_refiner(folder, run, settings, held_out)
        if kept is not None:
            return kept
    crops = run_crops(run, source, with_matte=True, machine=machine)
    checkpoint = None if folder is None else folder / CHECKPOINT
    refiner = refiner_of(run.puppet, crops, run.fit, settings, machine, held_out, checkpoint, tell)
    if folder is not None:
        save_refiner(folder, refiner, _identity(run, settings, held_out))
    return refiner


def kept_refiner(
    folder: Path, run: RunFolder, settings: RefineSettings, hold_out: Collection[int] = ()
) -> Refiner | None:
    """Read the finished refiner that was made from just these; None where ``folder`` holds none or another."""
    identity = _identity(run, settings, tuple(sorted(set(hold_out))))
    return load_refiner(folder, run.puppet) if is_made_from(folder / DESCRIPTION, identity) else None


def _identity(run: RunFolder, settings: RefineSettings, hold_out: tuple[int, ...]) -> str:
    """Name a training by all that its result depends on."""
    files = {name: digest for name, digest in run.run["files"].items() if name.startswith("carry/")}
    return digest_of([SCHEMA, files, msgspec.to_builtins(settings), hold_out])


def check_refiner_out(out: Path) -> None:
    """Raise InputError when ``out`` holds something that is no refiner of ours; empty or absent is fine."""
    check_only(out, OURS, "refiner")


def save_refiner(folder: Path, refiner: Refiner, identity: str = "") -> None:
    """Write a REFINER folder, refiner.json last, and take the checkpoint away; ``identity`` names the training."""
    examples = refiner.examples
    poses = {name: getattr(examples, name) for name in ("frames", "drawing", "vertices", "order")}
    with replaced_files(folder, DESCRIPTION, WEIGHTS) as beside:
        if refiner.generator is not None:
            tensors = {name: tensor.contiguous() for name, tensor in refiner.generator.state_dict().items()}
            save_file(tensors, beside / WEIGHTS, {"schema": SCHEMA})
        disk.save_puppet(refiner.puppet, beside)
        disk.write_arrays(beside / POSES, POSES_SCHEMA, poses)
        write_lossless(beside / DRAWINGS, examples.rgba)
    write_description(folder / DESCRIPTION, {**_described(refiner), "identity": identity})


def load_refiner(folder: Path, puppet: Puppet | None = None) -> Refiner:
    """Read a REFINER folder; with ``puppet`` given, only if it is the one that the refiner was trained for.

    Raises InputError where there is no refiner or it is another puppet's, StoreError for a damaged or a newer one.
    """
    found = read_description(folder / DESCRIPTION, FORMAT, "the REFINER folder of `wildpuppet refine`")
    if puppet is not None and puppet_digest(puppet) != found["puppet"]:
        raise InputError(
            f"{folder}: this refiner was trained for another puppet (parts: {', '.join(found['parts'][:3])}, ...); "
            "train one on a run of this puppet"
        )
    settings = msgspec.convert(found["settings"], RefineSettings)
    poses = disk.read_arrays(folder / POSES, POSES_SCHEMA)
    drawings = VideoImages(folder / DRAWINGS)
    examples = Examples(rgba=drawings[0 : len(poses["frames"])], **poses)
    return Refiner(
        disk.load_puppet(folder),
        examples,
        settings,
        msgspec.convert(found["weights"], Weights),
        _generator(folder / WEIGHTS, settings),
        found["share"],
        tuple(found["hold_out"]),
    )


def _generator(path: Path, settings: RefineSettings) -> Generator | None:
    if settings.method == "texture":
        return None
    tensors, _ = read_tensors(path, "refiner")
    generator = new_generator(settings)
    generator.load_state_dict(tensors)
    return generator.eval()


def _described(refiner: Refiner) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "puppet": puppet_digest(refiner.puppet),
        "parts": list(refiner.puppet.names),
        "size": list(refiner.examples.size),
        "settings": msgspec.to_builtins(refiner.settings),
        "weights": msgspec.to_builtins(refiner.weights),
        "share": refiner.share,
        "hold_out": list(refiner.hold_out),
        "losses": in_short(refiner.losses),
    }
