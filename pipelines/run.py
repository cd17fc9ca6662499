"""`wildpuppet run`: the main job from the command line and from Python."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from wildpuppet.machine import Device

from .arguments import value_of
from .keyframes import keyframes_from
from .presets import merged, read_preset
from .reporter import Reporter, Silent, terminal
from .request import Request, check_box
from .session import STORE, Options, run_pipeline, tell_end
from .track_video import track_video

if TYPE_CHECKING:
    from wildpuppet.api import Run


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Turn a clip with one box around a character into a puppet mesh for every frame."""

    video: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="VIDEO")]
    """The clip: any file that FFmpeg reads."""
    bbox: Annotated[tuple[float, float, float, float], tyro.conf.arg(metavar="X,Y,W,H")]
    """The character's box in frame --at, in video pixels; four tokens work too."""
    at: Annotated[int | None, tyro.conf.arg(metavar="FRAME")] = None
    """Frame that the box is in; the first of the range when left out."""
    start: Annotated[int, tyro.conf.arg(metavar="FRAME")] = 0
    """First frame of the range."""
    end: Annotated[int | None, tyro.conf.arg(metavar="FRAME")] = None
    """End of the range; this frame is not in it. The clip's end when left out."""
    puppet: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Puppet folder; left out, one is made from frame --at and written to OUT/puppet."""
    keyframe: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="FRAME:FILE")] = ()
    """What is to stay fixed in a frame: a csv of part,canvas_x,canvas_y,x,y (points at rest and where they are in the
    video) or an npz with vertices_video (V,2). Give one for each such frame."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the results; out/NAME of the clip when left out."""


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the preset's settings as defaults, so that explicit flags win."""
    settings = read_preset(value_of(argv, "--config"))
    return Arguments(video=tyro.MISSING, bbox=tyro.MISSING, settings=settings)


def main(arguments: Arguments) -> None:
    """Run the pipeline, then say where the results are."""
    request = _request(arguments)
    with terminal() as reporter:
        is_written = run_pipeline(track_video, request, arguments, reporter)
    tell_end(request.out, arguments.until if not is_written else None)


def _request(arguments: Arguments) -> Request:
    check_box(arguments.bbox)
    return Request(
        source=arguments.video,
        out=arguments.out or Path("out") / arguments.video.stem,
        settings=arguments.checked_settings(),
        puppet=arguments.puppet,
        box_video=arguments.bbox,
        at=arguments.at,
        start=arguments.start,
        end=arguments.end,
        keyframes=keyframes_from(arguments.keyframe),
    )


def run(
    video: str | Path,
    bbox: tuple[float, float, float, float],
    *,
    at: int | None = None,
    start: int = 0,
    end: int | None = None,
    puppet: str | Path | None = None,
    keyframes: Mapping[int, str | Path] | None = None,
    out: str | Path | None = None,
    config: str = "",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    store: str | Path = STORE,
    device: Device = "auto",
    redo: str | None = None,
    reporter: Reporter | None = None,
) -> "Run":
    """Do what `wildpuppet run` does and open the result.

    ``settings`` is {"fit": {"steps": 200}, ...}, laid over the preset ``config``; ``keyframes`` is {frame: file}.
    Raises a WildPuppetError that says in one line what to mend.
    """
    from wildpuppet.api import open_run

    arguments = Arguments(
        video=Path(video),
        bbox=bbox,
        at=at,
        start=start,
        end=end,
        puppet=None if puppet is None else Path(puppet),
        keyframe=tuple(f"{frame}:{path}" for frame, path in (keyframes or {}).items()),
        out=None if out is None else Path(out),
        store=Path(store),
        redo=redo,
        device=device,
        settings=merged(read_preset(config), settings or {}),
    )
    request = _request(arguments)
    run_pipeline(track_video, request, arguments, reporter or Silent())
    return open_run(request.out)
