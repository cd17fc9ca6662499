"""preview.mp4 and sheet.png of a run that was made of another: over that run's pictures where they are still there."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet.errors import InputError
from wildpuppet.export.preview import preview_frames
from wildpuppet.export.sheet import sheet
from wildpuppet.export.source import source_of
from wildpuppet.machine import Progress
from wildpuppet.recut import clip_of_run, is_clip, source_of_run
from wildpuppet.remake.posed import Posed
from wildpuppet.runs import RunFolder
from wildpuppet.video.write import write_preview

Picture = UInt8[np.ndarray, "H W 3"]
PAPER = 235


def pictures_of_run(run: RunFolder, source: Path | None = None) -> Callable[[int], Picture] | None:
    """Give what reads a frame's picture; None where the run's clip or drawings are gone and ``source`` is not given."""
    try:
        place = clip_of_run(run, source) if is_clip(run) else source_of_run(run, source)
    except InputError:
        if source is not None:
            raise
        return None
    return source_of(place).picture


def write_shown(folder: Path, posed: Posed, picture_of: Callable[[int], Picture] | None, progress: Progress) -> None:
    """Write preview.mp4 and sheet.png into a folder; over grey paper where there are no pictures."""
    width, height = posed.size
    paper = np.full((height, width, 3), PAPER, np.uint8)
    shown = picture_of or (lambda frame: paper)
    frames, timing = posed.fit.frames, posed.animation.timing
    count = len(frames)

    def pictures() -> Iterator[Picture]:
        for done, frame in enumerate(frames.tolist()):
            yield shown(frame)
            progress(done + 1, count)

    film = preview_frames(pictures(), posed.puppet, posed.crops, posed.fit)
    write_preview(folder / "preview.mp4", film, timing.pts, timing.time_base)
    Image.fromarray(sheet(shown, posed.puppet, posed.crops, posed.fit)).save(folder / "sheet.png")
