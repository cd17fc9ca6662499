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
    """Time the renderer beside its plain-torch reference; with RUN, say how fast that run's stages were too."""

    run: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="RUN")] = None
    """OUT folder of a run: its frames per second by stage, beside optical flow over the same frames."""
    sizes: Annotated[tuple[int, ...], tyro.conf.arg(metavar="PIXELS")] = (128, 256, 512)
    """Sides of the square pictures, in pixels."""
    seconds: float = 2.0
    """Seconds for each row; more seconds find a quieter moment of a busy machine."""
    threads: int = 1
    """Threads; one is timed by the processor's clock, more by the wall's."""


def main(arguments: Arguments) -> None:
    """Time, then tell."""
    from .time_renderer import measure_renderer
    from .time_run import flow_lines, stage_lines

    if min((arguments.threads, *arguments.sizes)) < 1 or arguments.seconds <= 0:
        raise SettingsError("wildpuppet bench: expected --sizes, --seconds and --threads above 0")
    stages = [] if arguments.run is None else stage_lines(arguments.run)  # tells of a wrong folder before the wait
    rows = measure_renderer(arguments.sizes, seconds=arguments.seconds, num_threads=arguments.threads)
    tell([*renderer_lines(rows), *stages])
    if arguments.run is not None:
        tell(flow_lines(arguments.run))


def tell(lines: list[str]) -> None:
    """Write lines to stdout."""
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.stdout.flush()


def renderer_lines(rows: "list[RendererRow]") -> list[str]:
    """Tabulate milliseconds per frame; where both renderers were timed, how many times faster ours is."""
    lines = [f"{'pixels':>6}  {'renderer':<10}{'forward':>9}{'+ backward':>12}   ms per frame"]
    of = {(row.pixels, row.backend): row for row in rows}
    for row in rows:
        lines.append(f"{row.pixels:>6}  {row.backend:<10}{row.forward:>9.2f}{row.forward_backward:>12.2f}")
        ours = of.get((row.pixels, "cpu"))
        if row.backend == "reference" and ours:
            forward, both = row.forward / ours.forward, row.forward_backward / ours.forward_backward
            lines.append(f"{'':>6}  {'ratio':<10}{forward:>9.1f}{both:>12.1f}")
    return lines
