"""The MODEL folder: a trained deformation network on disk, with the puppet it was trained for.

model.safetensors   the weights
model.json          schema, digest of the puppet, crop size, recipe, settings, losses in short
puppet.npz          the built puppet, so that a model can be used alone

model.json is written last and without times: a training that is done again gives the same bytes.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from wildpuppet import atomic, disk
from wildpuppet.deform.model import Model, Recipe
from wildpuppet.deform.network import Network, empty_network
from wildpuppet.deform.reader import reader_from
from wildpuppet.errors import InputError, StoreError
from wildpuppet.settings import TrainSettings
from wildpuppet.store import check_format, read_json
from wildpuppet.types import Puppet

FORMAT = "wildpuppet.model"
SCHEMA = f"{FORMAT}/1"
DESCRIPTION = "model.json"
WEIGHTS = "model.safetensors"
CHECKPOINT = "training.safetensors"
"""The unfinished training, beside where the model will be."""
OURS = (DESCRIPTION, WEIGHTS, CHECKPOINT, "puppet.npz", "run")
"""What may lie in a MODEL folder; ``run`` where drawings were fitted first."""
SHOWN_LOSSES = 50
"""Losses are written as means over so many stretches of the training."""


def puppet_digest(puppet: Puppet) -> str:
    """Give the digest of a built puppet's meshes and textures.

    Hinges do not count: each run learns their places anew, and a model moves the same puppet wherever they are.
    """
    digest = hashlib.blake2b(json.dumps([puppet.names, puppet.canvas]).encode(), digest_size=20)
    for array in (puppet.vertices, puppet.triangles, puppet.layer_of_vertex, puppet.uv, puppet.atlas):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def check_model_out(out: Path) -> None:
    """Raise InputError when ``out`` holds something that is no model of ours; an empty or absent folder is fine."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: expected a folder, found a file; give another one")
    others = sorted(item.name for item in out.glob("*") if item.name not in OURS) if out.is_dir() else []
    others = [name for name in others if not name.startswith(atomic.PREFIX)]
    if others:
        raise InputError(f"--out {out}: not empty and not a model's folder (found {others[0]}); give a new folder")


def was_made_from(folder: Path, identity: str) -> bool:
    """Tell whether ``folder`` holds the finished model of a training."""
    path = folder / DESCRIPTION
    return path.is_file() and read_json(path).get("identity") == identity


def save_model(folder: Path, model: Model, identity: str = "") -> None:
    """Write a MODEL folder, model.json last, and take the checkpoint away; ``identity`` names the training.

    Raises StoreError where the disk refuses.
    """
    assert isinstance(model.network, nn.Module)
    with atomic.disk_errors(folder), atomic.new_folder(folder) as beside:
        tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in model.network.state_dict().items()}
        save_file(tensors, beside / WEIGHTS, {"schema": SCHEMA})
        disk.save_puppet(model.puppet, beside)
        for name in (WEIGHTS, "puppet.npz"):
            atomic.flush(beside / name)
            (beside / name).replace(folder / name)
    description = {**_described(model), "identity": identity}
    atomic.write_text(folder / DESCRIPTION, json.dumps(description, indent=1, sort_keys=True) + "\n")
    (folder / CHECKPOINT).unlink(missing_ok=True)


def load_model(folder: Path, puppet: Puppet | None = None) -> Model:
    """Read a MODEL folder; with ``puppet`` given, only if it is the one that the model was trained for.

    Raises InputError where there is no model or it is another puppet's, StoreError for a damaged or a newer one.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        found = "a folder without model.json" if folder.is_dir() else "a file" if folder.exists() else "nothing"
        raise InputError(f"{folder}: expected the MODEL folder of `wildpuppet train`, found {found}")
    found = read_json(path)
    check_format(FORMAT, found.get("schema"), path)
    own = disk.load_puppet(folder)
    if puppet is not None and puppet_digest(puppet) != found["puppet"]:
        raise InputError(f"{folder}: {_other(own, puppet)}; train a model for this puppet, or use the model's own")
    train = msgspec.convert(found["settings"], TrainSettings)
    size = (int(found["size"][0]), int(found["size"][1]))
    network = _network(folder / WEIGHTS, train, found["recipe"])
    held_out = tuple(found["hold_out"])
    return Model(own, size, network, train, found["recipe"], found["is_on_paper"], held_out)


def _other(own: Puppet, given: Puppet) -> str:
    """Say how two puppets differ."""
    if own.names != given.names:
        names = [", ".join(puppet.names[:3]) + (", ..." if puppet.num_layers > 3 else "") for puppet in (own, given)]
        return (
            f"this model was trained for another puppet: expected {own.num_layers} parts ({names[0]}), "
            f"found {given.num_layers} ({names[1]})"
        )
    return (
        f"this model was trained for another puppet: the parts have the same names, but other meshes or textures "
        f"({len(own.vertices)} vertices expected, {len(given.vertices)} found)"
    )


def _described(model: Model) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "puppet": puppet_digest(model.puppet),
        "size": list(model.size),
        "recipe": model.recipe,
        "is_on_paper": model.is_on_paper,
        "hold_out": list(model.hold_out),
        "settings": msgspec.to_builtins(model.train),
        "losses": {name: _in_short(values) for name, values in sorted(model.losses.items())},
    }


def _in_short(values: np.ndarray) -> list[float]:
    stretches = np.array_split(values, min(SHOWN_LOSSES, max(len(values), 1)))
    return [float(f"{stretch.mean():.6g}") for stretch in stretches if len(stretch)]


def _network(path: Path, train: TrainSettings, recipe: Recipe) -> Network:
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
        raise StoreError(f"{path}: not a whole model ({error}); train it again") from None
    if recipe == "ours":
        return reader_from(tensors, train.encoder_pixels).eval()
    network = empty_network(tensors["base"], train)
    network.load_state_dict(tensors)
    return network.eval()
