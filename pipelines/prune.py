"""`wildpuppet prune`: clear results that no run refers to."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from wildpuppet.runs import RUN
from wildpuppet.store import Store

from .session import STORE


@dataclass(frozen=True)
class Arguments:
    """Clear kept results that no run uses any more, and what killed runs left behind.

    A run counts as long as its OUT folder is there; a run that was stopped counts until it is finished elsewhere.
    """

    store: Annotated[Path, tyro.conf.arg(metavar="DIR")] = STORE
    """Folder of kept results."""


def main(arguments: Arguments) -> None:
    """Forget runs whose OUT is gone, then clear what nobody uses."""
    store = Store(arguments.store)
    if not arguments.store.exists():
        sys.stdout.write(f"{arguments.store}: no store there, nothing to clear\n")
        return
    for name, note in store.runs().items():
        if note.get("is_finished") and not (Path(note["out"]) / RUN).is_file():
            store.forget_run(name)
    pruned = store.prune()
    sys.stdout.write(
        f"cleared {pruned.entries} results ({pruned.num_bytes / 1e6:.1f} MB) "
        f"and {pruned.leftovers} leftovers of stopped runs\n"
    )
