"""`wildpuppet puppet check`: say in words what is wrong with a puppet folder."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from wildpuppet import atomic


@dataclass(frozen=True)
class Arguments:
    """Say in words what is wrong with a puppet folder, and draw DIR/overlay.png. Exits with 1 on findings."""

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]
    """The puppet folder: puppet.json and its part images."""


def main(arguments: Arguments) -> int:
    """Check, draw, tell."""
    from PIL import Image

    from wildpuppet.puppet.build import build
    from wildpuppet.puppet.check import check
    from wildpuppet.puppet.folder import read_cutout
    from wildpuppet.puppet.overlay import overlay
    from wildpuppet.settings import PuppetSettings

    cutout = read_cutout(arguments.folder)
    findings = check(cutout)
    picture = overlay(cutout, build(cutout, PuppetSettings()))
    with atomic.disk_errors(arguments.folder), atomic.new_folder(arguments.folder) as beside:
        Image.fromarray(picture).save(beside / "overlay.png")
        (beside / "overlay.png").replace(arguments.folder / "overlay.png")
    for finding in findings:
        sys.stdout.write(f"{finding}\n")
    sys.stdout.write(f"{len(findings) or 'no'} findings; see {arguments.folder / 'overlay.png'}\n")
    return 1 if findings else 0
