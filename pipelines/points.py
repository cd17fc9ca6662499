"""`wildpuppet points`: carry points from one frame to every frame of a run."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from wildpuppet.errors import InputError


@dataclass(frozen=True)
class Arguments:
    """Carry points from one frame of a run to all of its frames, through the puppet."""

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """OUT folder of a run."""
    points: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="POINTS.csv")]
    """Rows of x,y[,part] in video pixels; part names the part of a point that is hidden in that frame."""
    frame: Annotated[int, tyro.conf.arg(metavar="FRAME")]
    """Frame number of the clip (or of the drawing, in sorted file order) that the points are in."""
    out: Annotated[Path, tyro.conf.arg(metavar="TRACKS.npz")]
    """File to write: points (T,N,2) f32, visible (T,N) bool, confidence (T,N) f32, frames (T,) i64."""


def main(arguments: Arguments) -> None:
    """Carry and write."""
    from wildpuppet.api import open_run
    from wildpuppet.correspond.points import read_points, write_tracks

    if arguments.out.suffix != ".npz":
        raise InputError(f"--out {arguments.out}: expected a name that ends with .npz")
    run = open_run(arguments.run)
    points, parts = read_points(arguments.points)
    tracks = run.carry(points, arguments.frame, parts)
    write_tracks(arguments.out, tracks)
    sys.stdout.write(f"{arguments.out}: {len(points)} points in {len(tracks.frames)} frames\n")
