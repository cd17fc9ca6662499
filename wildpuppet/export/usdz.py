"""OpenUSD in one file with its texture inside: for handing over, and for the previews of Apple's systems."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory

from wildpuppet.errors import StoreError
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.export.usd import refusals_told
from wildpuppet.export.usd import write as write_usd
from wildpuppet.machine import Progress

DATE = 946728000
"""Noon of the first of January 2000, UTC: the package notes its files' dates, and the same run gives the same bytes."""


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write FOLDER/puppet.usdz."""
    from pxr import UsdUtils

    with TemporaryDirectory(dir=folder) as loose:
        manifest = write_usd(animation, Path(loose), options, progress)
        for path in Path(loose).iterdir():
            os.utime(path, (DATE, DATE))
        with refusals_told():
            is_written = UsdUtils.CreateNewUsdzPackage(str(Path(loose) / "puppet.usdc"), str(folder / "puppet.usdz"))
        if not is_written:
            raise StoreError("--to usdz: usd-core could not write the package; free some space")
    return manifest
