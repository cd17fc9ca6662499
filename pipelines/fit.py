"""`wildpuppet fit`: a puppet on a folder of unordered drawings, from the command line and from Python."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from wildpuppet.errors import SettingsError
from wildpuppet.machine import Device

from .arguments import value_of
from .fit_drawings import fit_drawings
from .presets import merged, read_preset
from .reporter import Reporter, Silent, terminal
from .request import Request
from .session import STORE, Options, run_pipeline, tell_end

if TYPE_CHECKING:
    from wildpuppet.api import Run


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Fit a puppet to a folder of unordered drawings: no tracking, one canvas. Frames count in sorted file order."""

    frames_dir: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FRAMES_DIR")]
    """Folder of drawings of one size, with alpha or on one plain colour."""
    puppet: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Puppet folder."""
    out: Annotated[Path, tyro.conf.arg(metavar="RUN")]
    """Folder for the results."""
    test_share: Annotated[float, tyro.conf.arg(metavar="SHARE")] = 0.0
    """Share of the drawings that no training sees (fit.method network); run.json lists them."""


def defaults(argv: Sequence[str]) -> Arguments:
    """Take the preset's settings as defaults, so that explicit flags win."""
    settings = read_preset(value_of(argv, "--config"))
    return Arguments(frames_dir=tyro.MISSING, puppet=tyro.MISSING, out=tyro.MISSING, settings=settings)


def main(arguments: Arguments) -> None:
    """Run the pipeline, then say where the results are."""
    request = _request(arguments)
    with terminal() as reporter:
        is_written = run_pipeline(fit_drawings, request, arguments, reporter)
    tell_end(request.out, arguments.until if not is_written else None)


def _request(arguments: Arguments) -> Request:
    if not 0.0 <= arguments.test_share < 1.0:
        raise SettingsError(f"--test-share {arguments.test_share:g}: expected a share of at least 0 and below 1")
    return Request(
        source=arguments.frames_dir,
        out=arguments.out,
        settings=arguments.checked_settings(),
        puppet=arguments.puppet,
        test_share=arguments.test_share,
    )


def fit(
    frames_dir: str | Path,
    puppet: str | Path,
    out: str | Path,
    *,
    test_share: float = 0.0,
    config: str = "",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    store: str | Path = STORE,
    device: Device = "auto",
    redo: str | None = None,
    reporter: Reporter | None = None,
) -> "Run":
    """Do what `wildpuppet fit` does and open the result; the arguments are those of ``wildpuppet.run``."""
    from wildpuppet.api import open_run

    arguments = Arguments(
        frames_dir=Path(frames_dir),
        puppet=Path(puppet),
        out=Path(out),
        test_share=test_share,
        store=Path(store),
        redo=redo,
        device=device,
        settings=merged(read_preset(config), settings or {}),
    )
    request = _request(arguments)
    run_pipeline(fit_drawings, request, arguments, reporter or Silent())
    return open_run(request.out)
