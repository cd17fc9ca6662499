"""`wildpuppet bench`: how fast the renderer is on this machine, and how fast a run was, stage by stage."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from wildpuppet.errors import SettingsError

if TYPE_CHECKING:
    from .time_renderer import RendererRow


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Time the renderer beside its plain-torch reference; with --run, say how fast that run's stages were."""

    run: Annotated[Path | None, tyro.conf.arg(metavar="RUN")] = None
    """OUT folder of a run: print its frames per second by stage."""
    sizes: Annotated[tuple[int, ...], tyro.conf.arg(metavar="PIXELS")] = (128, 256, 512)
    """Sides of the square pictures, in pixels."""
    seconds: float = 2.0
    """Seconds for each row; more seconds find a quieter moment of a busy machine."""
    threads: int = 1
    """Threads; one is timed by the processor's clock, more by the wall's."""


def main(arguments: Arguments) -> None:
    """Time, then tell."""
    from .time_renderer import measure_renderer

    if min((arguments.threads, *arguments.sizes)) < 1 or arguments.seconds <= 0:
        raise SettingsError("wildpuppet bench: expected --sizes, --seconds and --threads above 0")
    stages = [] if arguments.run is None else stage_lines(arguments.run)  # tells of a wrong folder before the wait
    rows = measure_renderer(arguments.sizes, seconds=arguments.seconds, num_threads=arguments.threads)
    sys.stdout.write("".join(f"{line}\n" for line in [*renderer_lines(rows), *stages]))


def renderer_lines(rows: "list[RendererRow]") -> list[str]:
    """Tabulate milliseconds per frame."""
    lines = [f"{'pixels':>6}  {'renderer':<10}{'forward':>9}{'+ backward':>12}   ms per frame"]
    return lines + [
        f"{row.pixels:>6}  {row.backend:<10}{row.forward:>9.2f}{row.forward_backward:>12.2f}" for row in rows
    ]


def stage_lines(folder: Path) -> list[str]:
    """Tabulate what each stage of a run took when its results were made."""
    from wildpuppet.runs import TIMINGS, read_run
    from wildpuppet.store import read_json

    num_frames = len(read_run(folder)["frames"])
    seconds: dict[str, float] = read_json(folder / TIMINGS)["seconds"]
    whole = {**seconds, "all": sum(seconds.values())}
    lines = ["", f"{'stage':<10}{'seconds':>9}{'frames per second':>20}   {num_frames} frames of {folder}"]
    return lines + [f"{name:<10}{took:>9.1f}{num_frames / max(took, 1e-3):>20.2f}" for name, took in whole.items()]
