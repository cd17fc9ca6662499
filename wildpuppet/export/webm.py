"""VP9 with alpha in WebM: browsers and the tools built on them."""

from pathlib import Path

from wildpuppet.export.alpha_video import write_kind
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write one .webm per part and one of the whole puppet."""
    return write_kind(animation, folder, options, progress, "webm")
