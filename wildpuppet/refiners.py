"""The REFINER folder: a finished refinement on disk, with the puppet and the drawings that it knows.

refiner.safetensors   the generator's weights (none for the method "texture")
drawings.mkv          the drawings, premultiplied RGBA, lossless
poses.npz             where the puppet is in each
puppet.npz            the built puppet, so that a refiner can be used alone
refiner.json          schema, digest of the puppet, settings, weights of the drawings, frames held out, losses in short

refiner.json is written last and without times: a training that is done again gives the same bytes.
"""

import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from wildpuppet import atomic, disk
from wildpuppet.errors import InputError, StoreError
from wildpuppet.machine import Machine
from wildpuppet.models import puppet_digest
from wildpuppet.recut import run_crops
from wildpuppet.refine.examples import Examples
from wildpuppet.refine.learn import Tell, new_generator, quiet
from wildpuppet.refine.network import Generator
from wildpuppet.refine.refiner import Refiner, refiner_of
from wildpuppet.refine.texture import Weights
from wildpuppet.runs import RunFolder
from wildpuppet.settings import RefineSettings
from wildpuppet.store import check_format, digest_of, read_json
from wildpuppet.types import Puppet
from wildpuppet.video.lossless import VideoImages, write_lossless

FORMAT = "wildpuppet.refiner"
SCHEMA = f"{FORMAT}/1"
DESCRIPTION = "refiner.json"
WEIGHTS = "refiner.safetensors"
DRAWINGS = "drawings.mkv"
POSES = "poses.npz"
POSES_SCHEMA = "wildpuppet.refiner.poses/1"
CHECKPOINT = "training.safetensors"
"""The unfinished training, beside where the refiner will be."""
OURS = (DESCRIPTION, WEIGHTS, DRAWINGS, POSES, CHECKPOINT, "puppet.npz")
SHOWN_LOSSES = 50


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
    path = folder / DESCRIPTION
    identity = _identity(run, settings, tuple(sorted(set(hold_out))))
    if not path.is_file() or read_json(path).get("identity") != identity:
        return None
    return load_refiner(folder, run.puppet)


def _identity(run: RunFolder, settings: RefineSettings, hold_out: tuple[int, ...]) -> str:
    """Name a training by all that its result depends on."""
    files = {name: digest for name, digest in run.run["files"].items() if name.startswith("carry/")}
    return digest_of([SCHEMA, files, msgspec.to_builtins(settings), hold_out])


def check_refiner_out(out: Path) -> None:
    """Raise InputError when ``out`` holds something that is no refiner of ours; empty or absent is fine."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: expected a folder, found a file; give another one")
    others = sorted(item.name for item in out.glob("*") if item.name not in OURS) if out.is_dir() else []
    others = [name for name in others if not name.startswith(atomic.PREFIX)]
    if others:
        raise InputError(f"{out}: not empty and not a refiner's folder (found {others[0]}); give a new folder")


def save_refiner(folder: Path, refiner: Refiner, identity: str = "") -> None:
    """Write a REFINER folder, refiner.json last, and take the checkpoint away; ``identity`` names the training."""
    examples = refiner.examples
    poses = {name: getattr(examples, name) for name in ("frames", "drawing", "vertices", "order")}
    with atomic.disk_errors(folder), atomic.new_folder(folder) as beside:
        (folder / DESCRIPTION).unlink(missing_ok=True)
        (folder / WEIGHTS).unlink(missing_ok=True)
        if refiner.generator is not None:
            tensors = {name: tensor.contiguous() for name, tensor in refiner.generator.state_dict().items()}
            save_file(tensors, beside / WEIGHTS, {"schema": SCHEMA})
        disk.save_puppet(refiner.puppet, beside)
        disk.write_arrays(beside / POSES, POSES_SCHEMA, poses)
        write_lossless(beside / DRAWINGS, examples.rgba)
        for path in sorted(beside.iterdir()):
            atomic.flush(path)
            path.replace(folder / path.name)
    description = {**_described(refiner), "identity": identity}
    atomic.write_text(folder / DESCRIPTION, json.dumps(description, indent=1, sort_keys=True) + "\n")
    (folder / CHECKPOINT).unlink(missing_ok=True)


def load_refiner(folder: Path, puppet: Puppet | None = None) -> Refiner:
    """Read a REFINER folder; with ``puppet`` given, only if it is the one that the refiner was trained for.

    Raises InputError where there is no refiner or it is another puppet's, StoreError for a damaged or a newer one.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        found = "a folder without refiner.json" if folder.is_dir() else "a file" if folder.exists() else "nothing"
        raise InputError(f"{folder}: expected the REFINER folder of `wildpuppet refine`, found {found}")
    found = read_json(path)
    check_format(FORMAT, found.get("schema"), path)
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
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
        raise StoreError(f"{path}: not a whole refiner ({error}); train it again") from None
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
        "losses": {name: _in_short(values) for name, values in sorted(refiner.losses.items())},
    }


def _in_short(values: np.ndarray) -> list[float]:
    stretches = np.array_split(values, min(SHOWN_LOSSES, max(len(values), 1)))
    return [float(f"{stretch.mean():.6g}") for stretch in stretches if len(stretch)]
