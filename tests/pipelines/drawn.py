"""A tiny drawn clip with its puppet, and settings that make a run on it take about a second."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from pipelines.cli import run_command
from tests.scenes import Scene, make_scene, write_clip
from wildpuppet.puppet.folder import write_cutout

FRAMES = 8
REFERENCE = 3
QUICK = (
    "--crop.box-pixels=64", "--crop.matte=False", "--search.enabled=False", "--puppet.edge=0.25", "--fit.steps=3",
    "--out.preview=False",
)  # fmt: skip


@cache
def scene() -> Scene:
    return make_scene("walk", frames=FRAMES, size=(160, 120), seed=3)


@dataclass(frozen=True)
class Drawn:
    """Where the clip and the puppet lie."""

    folder: Path

    @property
    def video(self) -> Path:
        return self.folder / "clip.mp4"

    @property
    def puppet(self) -> Path:
        return self.folder / "puppet"

    @property
    def box(self) -> str:
        return ",".join(f"{side:g}" for side in scene().boxes[REFERENCE])

    def arguments(self, out: str = "out", store: str = "store") -> list[str]:
        """The command line of a run; later flags win over ``QUICK``."""
        words = ["run", str(self.video), "--bbox", self.box, "--at", str(REFERENCE), "--puppet", str(self.puppet)]
        return [*words, "--out", str(self.folder / out), "--store", str(self.folder / store), *QUICK]

    def run(self, *more: str, out: str = "out", store: str = "store") -> int:
        return run_command([*self.arguments(out, store), *more])


def drawn_in(folder: Path) -> Drawn:
    """Draw the clip and the puppet into a folder."""
    drawn = Drawn(folder)
    write_clip(scene(), drawn.video)
    write_cutout(scene().cutout, drawn.puppet)
    return drawn


def write_drawings(folder: Path) -> Path:
    """Write the clip's frames as drawings with transparency."""
    folder.mkdir()
    for index in range(FRAMES):
        picture = np.dstack([scene().frames[index], scene().alpha[index]])
        Image.fromarray(picture).save(folder / f"{index:02d}.png")
    return folder


def final_files(out: Path) -> dict[str, bytes]:
    """Every file of OUT whose bytes a run promises: all but timings.json."""
    files = sorted(path for path in out.rglob("*") if path.is_file() and path.name != "timings.json")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def made_now(err: str) -> list[str]:
    """Which steps a run reported as made rather than kept."""
    return [line.split(":")[0] for line in err.splitlines() if ": " in line and not line.endswith("kept")]
