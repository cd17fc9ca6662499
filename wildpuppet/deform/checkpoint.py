"""Unfinished training on disk: one safetensors file, always whole, that a killed run goes on from.

The file holds the network, Adam's state and the losses so far; its header holds the number of finished steps and an
identity, so that a file of another training is never taken for this one's.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from wildpuppet.atomic import PREFIX, disk_errors, flush
from wildpuppet.errors import StoreError

SCHEMA = "wildpuppet.training/1"
MOMENTS = ("step", "exp_avg", "exp_avg_sq")


@dataclass(frozen=True, eq=False)
class Progress:
    """How far a training is: finished steps and the losses of all steps (those to come are 0)."""

    step: int
    losses: Float[Tensor, "S K"]


def save_checkpoint(
    path: Path, network: nn.Module, optimizer: torch.optim.Adam, progress: Progress, identity: str
) -> None:
    """Write how far a training is."""
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    for name, parameter in network.named_parameters():
        state = optimizer.state.get(parameter, {})
        tensors |= {f"adam.{name}.{moment}": state[moment] for moment in MOMENTS if moment in state}
    tensors["losses"] = progress.losses
    write_tensors(path, tensors, {"schema": SCHEMA, "identity": identity, "step": str(progress.step)})


def write_tensors(path: Path, tensors: Mapping[str, Tensor], header: dict[str, str]) -> None:
    """Write a safetensors file, whole or not at all: beside, flush, rename."""
    beside = path.with_name(f"{PREFIX}{os.getpid()}-{path.name}")
    with disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            save_file({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, beside, header)
            flush(beside)
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)


def load_checkpoint(path: Path, network: nn.Module, optimizer: torch.optim.Adam, identity: str) -> Progress | None:
    """Put network and optimizer where they were; None where there is no checkpoint.

    Raises:
        StoreError: the file is damaged or belongs to another training.
    """
    if not path.exists():
        return None
    tensors, header = read_tensors(path, "checkpoint")
    if header.get("schema") != SCHEMA or header.get("identity") != identity:
        raise StoreError(f"{path}: expected a checkpoint of this training, found another's; delete it to start anew")
    network.load_state_dict({name: tensors[f"network.{name}"] for name in network.state_dict()})
    for name, parameter in network.named_parameters():
        found = {moment: tensors[key] for moment in MOMENTS if (key := f"adam.{name}.{moment}") in tensors}
        optimizer.state[parameter] = {moment: tensor.to(parameter.device) for moment, tensor in found.items()}
    return Progress(int(header["step"]), tensors["losses"])


def read_tensors(path: Path, what: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read a safetensors file and its header; raises StoreError for a damaged one, which ``what`` names."""
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            return {name: file.get_tensor(name) for name in file.keys()}, header  # noqa: SIM118 (not a dict)
    except (SafetensorError, OSError) as error:
        raise StoreError(f"{path}: not a whole {what} ({error}); delete it to train from the start") from None
