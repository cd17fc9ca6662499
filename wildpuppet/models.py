"""The MODEL folder: a trained deformation network on disk, with the puppet it was trained for.

model.safetensors   the weights
model.json          schema, digest of the puppet, crop size, recipe, settings, losses in short
puppet.npz          the built puppet, so that a model can be used alone

model.json is written last and without times: a training that is done again gives the same bytes.
"""

from pathlib import Path
from typing import Any

import msgspec
from safetensors.torch import save_file
from torch import nn

from wildpuppet import disk
from wildpuppet.deform.checkpoint import read_tensors
from wildpuppet.deform.model import Model, Recipe
from wildpuppet.deform.network import Network, empty_network
from wildpuppet.deform.reader import reader_from
from wildpuppet.errors import InputError
from wildpuppet.settings import TrainSettings
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

FORMAT = "wildpuppet.model"
SCHEMA = f"{FORMAT}/1"
DESCRIPTION = "model.json"
WEIGHTS = "model.safetensors"
OURS = (DESCRIPTION, WEIGHTS, CHECKPOINT, "puppet.npz", "run")
"""What may lie in a MODEL folder; ``run`` where drawings were fitted first."""


def check_model_out(out: Path) -> None:
    """Raise InputError when ``out`` holds something that is no model of ours; an empty or absent folder is fine."""
    check_only(out, OURS, "model", "--out ")


def was_made_from(folder: Path, identity: str) -> bool:
    """Tell whether ``folder`` holds the finished model of a training."""
    return is_made_from(folder / DESCRIPTION, identity)


def save_model(folder: Path, model: Model, identity: str = "") -> None:
    """Write a MODEL folder, model.json last, and take the checkpoint away; ``identity`` names the training.

    Raises StoreError where the disk refuses.
    """
    assert isinstance(model.network, nn.Module)
    with replaced_files(folder, DESCRIPTION) as beside:
        tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in model.network.state_dict().items()}
        save_file(tensors, beside / WEIGHTS, {"schema": SCHEMA})
        disk.save_puppet(model.puppet, beside)
    write_description(folder / DESCRIPTION, {**_described(model), "identity": identity})


def load_model(folder: Path, puppet: Puppet | None = None) -> Model:
    """Read a MODEL folder; with ``puppet`` given, only if it is the one that the model was trained for.

    Raises InputError where there is no model or it is another puppet's, StoreError for a damaged or a newer one.
    """
    found = read_description(folder / DESCRIPTION, FORMAT, "the MODEL folder of `wildpuppet train`")
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
        "losses": in_short(model.losses),
    }


def _network(path: Path, train: TrainSettings, recipe: Recipe) -> Network:
    tensors, _ = read_tensors(path, "model")
    if recipe == "ours":
        return reader_from(tensors, train.encoder_pixels).eval()
    network = empty_network(tensors["base"], train)
    network.load_state_dict(tensors)
    return network.eval()
