"""The Python API beside ``wildpuppet.run``: open what a run left and ask it for correspondences.

run = wildpuppet.run("clip.mp4", (285, 125, 275, 318), at=150, puppet="puppet")
tracks = wildpuppet.open_run("out/clip").carry([[400.0, 200.0]], frame=150)
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from wildpuppet import finish
from wildpuppet.correspond.carry import carry
from wildpuppet.correspond.flow import DenseFlow, flow
from wildpuppet.deform.model import Model
from wildpuppet.errors import InputError
from wildpuppet.export.export import export
from wildpuppet.export.formats import formats_of
from wildpuppet.export.options import Options, Pictures
from wildpuppet.export.source import source_of
from wildpuppet.machine import Machine, Progress, silent
from wildpuppet.motion.inbetween import Method
from wildpuppet.paint.of_run import paint_run
from wildpuppet.paint.paint import Over
from wildpuppet.paint.template import write_template
from wildpuppet.recut import place_of_run
from wildpuppet.refine.refiner import Refiner
from wildpuppet.refiners import refiner_of_run
from wildpuppet.remake.deform import Deformed, Handle, deformed_frame, handle_from
from wildpuppet.remake.inbetween import SIZE, Inbetweens, inbetweens_of_run
from wildpuppet.remake.retarget import Retargeted, retargeted_run
from wildpuppet.runs import RunFolder
from wildpuppet.settings import RefineSettings
from wildpuppet.types import PointTracks


class Run(RunFolder):
    """A finished run: its puppet, crops and fit are read when asked for; the store is not needed."""

    def carry(self, points: ArrayLike, frame: int, parts: Sequence[str | None] | None = None) -> PointTracks:
        """Carry points (N, 2), video pixels of ``frame``, to every frame of the run.

        ``parts[n]`` names the part that point n lies on, for points that are hidden in that frame; without it, it is
        the frontmost part under the point, else the nearest. Raises InputError for a frame outside the run.
        """
        array = np.asarray(points, np.float64)
        if array.ndim != 2 or array.shape[1] != 2:
            raise InputError(f"points: expected shape (N, 2), found {array.shape}")
        return carry(self.puppet, self.crops, self.fit, array, frame, parts, self.size)

    def flow(self, source: int, target: int) -> DenseFlow:
        """Give the dense map from frame ``source`` to frame ``target`` over the puppet's visible surface."""
        return flow(self.puppet, self.crops, self.fit, source, target, self.size)

    def export(self, formats: str, out: str | Path, options: Options | None = None) -> list[Path]:
        """Write the run in formats separated by commas (``wildpuppet formats``); give OUT/FORMAT for each.

        Raises SettingsError for an unknown format, InputError for a missing extra or an ``out`` with other files.
        """
        return [export(self.animation, each, Path(out), options) for each in formats_of(formats)]

    def pictures(self, source: str | Path | None = None) -> Pictures:
        """Open the run's clip or drawings for ``Options(pictures=...)``; ``source``: where they lie now, when moved."""
        place = None if source is None else Path(source)
        return source_of(place_of_run(self, place)).picture

    def paint_template(self, place: str | Path) -> Path:
        """Write what to paint on: PLACE.psd, PLACE.ora, or a folder with a picture per part; give the place.

        Raises InputError where something is there already.
        """
        write_template(self.puppet, Path(place))
        return Path(place)

    def paint(
        self,
        texture: str | Path,
        out: str | Path,
        over: Over = "original",
        source: str | Path | None = None,
        progress: Progress = silent,
    ) -> Path:
        """Draw every frame anew with an edited texture, over the "original" frames, the "plate" or "none"; give OUT.

        ``texture`` is a folder of part pictures, a PSD, ORA or PNG; ``source`` where the clip lies now, when it was
        moved. Raises InputError for pictures that do not fit the puppet and for an ``out`` with other files.
        """
        return paint_run(self, Path(texture), Path(out), over, None if source is None else Path(source), progress)

    def inbetween(
        self,
        first: int,
        last: int,
        count: int = 3,
        method: Method = "ours",
        model: Model | None = None,
        size: int = SIZE,
        closely: bool = False,
        source: str | Path | None = None,
    ) -> Inbetweens:
        """Make ``count`` poses between frames ``first`` and ``last``; ``posed.animation`` of the result can be drawn.

        ``method`` "code" needs a ``model`` (``wildpuppet.models.load_model``). ``size`` is the larger side of the
        picture, which shows the run's whole picture, or with ``closely`` the character.
        """
        place = None if source is None else Path(source)
        return inbetweens_of_run(self, (first, last), count, method, model, size, closely, place)

    def retarget(self, to: str | Path, height: float = 1.0, match: Mapping[str, str] | None = None) -> Retargeted:
        """Put the run's motion on the puppet of folder ``to``; ``posed`` of the result is it in motion.

        ``height`` is how tall it becomes, as a share of the character it follows; ``match`` pairs parts whose names
        differ, the puppet's -> the run's. ``wildpuppet.remake.posed`` writes it as a run. Raises InputError where no
        part has a namesake.
        """
        return retargeted_run(self, Path(to), height, match)

    def refine(
        self,
        out: str | Path | None = None,
        over: finish.Over = "none",
        hold_out: Collection[int] = (),
        settings: RefineSettings | None = None,
        refiner: Refiner | None = None,
        source: str | Path | None = None,
        machine: Machine | None = None,
    ) -> Refiner:
        """Learn how the drawings look beside the rendered puppet; with ``out``, keep it and draw every frame with it.

        ``hold_out`` are frames that nothing is learnt from. A ``refiner`` that is given
        (``wildpuppet.refiners.load_refiner``) is used as it is. ``over`` is "none", "plate" or "white".
        """
        place, machine = None if source is None else Path(source), machine or Machine()
        folder = None if out is None else Path(out)
        if folder is not None:
            finish.check_finish_out(folder)
        if refiner is None:
            kept = None if folder is None else folder / finish.REFINER
            refiner = refiner_of_run(self, settings or RefineSettings(), machine, hold_out, kept, place)
        if folder is not None:
            finish.finish_run(self, refiner, folder, over, place, machine.progress)
        return refiner

    def deform(
        self,
        frame: int,
        handles: Sequence[Handle | str],
        model: Model | None = None,
        source: str | Path | None = None,
    ) -> Deformed:
        """Drag frame ``frame`` by handles, such as "hand:120,80->150,60" (part, point and target in video pixels).

        ``vertices`` of the result are video pixels, ``posed.animation`` can be drawn. With ``model`` (``load_model``)
        the network's codes are moved, else hinge rotations of the run's own frames. Raises InputError for a frame or
        a part that is not there and for a point beside its part.
        """
        read = [handle_from(handle) if isinstance(handle, str) else handle for handle in handles]
        return deformed_frame(self, frame, read, model, None if source is None else Path(source))


def open_run(path: str | Path) -> Run:
    """Open the OUT folder of a run; raises InputError where it is none."""
    run = Run(Path(path))
    _ = run.run
    return run
