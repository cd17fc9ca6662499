"""`wildpuppet flow`: write the dense map between two frames of a run."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Arguments:
    """Write the dense map from one frame of a run to another, over the puppet's visible surface."""

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    source: Annotated[int, tyro.conf.arg(name="from", metavar="FRAME")]
    """Frame that the map starts from; its pixels are the map's."""
    target: Annotated[int, tyro.conf.arg(name="to", metavar="FRAME")]
    """Frame that the map leads to."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """FILE.npz: flow (H,W,2) f32, NaN where no puppet is, and visible (H,W) bool; or FILE.flo (Middlebury)."""


def main(arguments: Arguments) -> None:
    """Compute and write."""
    from wildpuppet.api import open_run
    from wildpuppet.correspond.flow import write_flow

    dense = open_run(arguments.run).flow(arguments.source, arguments.target)
    write_flow(arguments.out, dense)
    share = dense.visible.mean()
    sys.stdout.write(f"{arguments.out}: frame {arguments.source} to {arguments.target}, {share:.0%} of the picture\n")
