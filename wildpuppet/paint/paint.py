"""Draw every frame of a run anew with a painted texture: RGBA pictures, a preview, a manifest.

Frames that show the same drawing at the same place are rendered once. Where something covers a held drawing or not is
decided anew only when the frame itself changed.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from wildpuppet import atomic
from wildpuppet.errors import InputError
from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.draw import is_same_picture, straight
from wildpuppet.export.export import check_unedited
from wildpuppet.export.manifest import MANIFEST, Manifest, write_manifest
from wildpuppet.export.png import write_sequence
from wildpuppet.export.source import Source
from wildpuppet.machine import Progress, silent
from wildpuppet.paint.compose import Look, over, painted
from wildpuppet.paint.covered import Palettes
from wildpuppet.paint.layers import Both, Drawn
from wildpuppet.paint.light import Light, light_of, lights
from wildpuppet.paint.texture import Edit
from wildpuppet.video.write import write_preview

Over = Literal["original", "plate", "none"]

FRAMES, PREVIEW, TEXTURE = "frames", "preview.mp4", "texture.png"
FORMAT = "paint"
REACH_SHARE, LEAST_REACH, MOST_REACH = 0.009, 2, 5
"""How far outlines may be off, as a share of the character's larger side, and in pixels."""
PAPER = 128
"""Grey behind the preview of pictures without background."""
WHITE: Light = (1.0, 1.0, 1.0)


@runtime_checkable
class Background(Protocol):
    """Gives frames without the character."""

    def picture(self, t: int, picture: UInt8[np.ndarray, "H W 3"], drawn: Drawn | None) -> UInt8[np.ndarray, "H W 3"]:
        """Take the character out of frame ``t`` of the run."""


@dataclass(frozen=True, eq=False)
class Job:
    """What to paint over what. ``source`` may be None for pictures without background, ``behind`` where none shows."""

    animation: Animation
    edit: Edit
    over: Over
    source: Source | None = None
    behind: Background | None = None


@dataclass(frozen=True)
class _Said(Manifest):
    """What the manifest says beside what every export says."""

    over: str = "original"
    painted_parts: tuple[str, ...] = ()
    light_changes: bool = False


def check_out(out: Path) -> None:
    """Raise InputError where ``out`` holds anything but an unchanged earlier painting."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: expected a folder, found a file; give another one")
    if out.is_dir() and any(out.iterdir()):
        if not (out / MANIFEST).is_file() or not (out / FRAMES).is_dir():
            raise InputError(f"--out {out}: holds other files; give a new or an empty folder")
        check_unedited(out)


def paint(job: Job, out: Path, progress: Progress = silent) -> Path:
    """Write OUT/frames/frame.NNNNN.png (numbers of the clip), preview.mp4, texture.png and manifest.json.

    An unchanged earlier painting in OUT is replaced. Raises InputError for an ``out`` with other files.
    """
    check_out(out)
    animation, both = job.animation, Both(job.animation, job.edit)
    total = len(animation) * (1 if job.source is None else 2)
    measured = _lights(job, both, lambda done: progress(done, total))
    with atomic.disk_errors(out.parent), atomic.new_folder(out.parent) as beside:
        folder = beside / out.name
        folder.mkdir()
        pictures = _pictures(job, both, measured)
        shown = _written(pictures, folder, animation, lambda done: progress(total - len(animation) + done, total))
        write_preview(folder / PREVIEW, shown, animation.timing.pts, animation.timing.time_base)
        Image.fromarray(job.edit.puppet.atlas).save(folder / TEXTURE)
        write_manifest(folder, FORMAT, animation, _said(job, measured))
        if out.exists():
            out.rename(beside / "replaced")
        folder.rename(out)
    return out


def _said(job: Job, measured: list[Light]) -> _Said:
    animation = job.animation
    left_out = list(job.edit.notes)
    if animation.timing.is_variable:
        left_out.append("the variable frame rate: picture i is shown at pts[i] * time_base seconds")
    return _Said(
        "top left corner of the picture",
        "x right, y down",
        int(animation.frames[0]),
        left_out=tuple(left_out),
        over=job.over,
        painted_parts=job.edit.parts,
        light_changes=len(set(measured)) > 1,
    )


def _lights(job: Job, both: Both, report: "_Report") -> list[Light]:
    """Measure the light of every frame; there is none to match without a source."""
    if job.source is None:
        return [WHITE] * len(job.animation)
    measured = []
    for frame, drawn in _drawn(job.animation, both):
        measured.append(light_of(job.source.picture(frame.number), drawn))
        report(frame.t + 1)
    return lights(measured, job.animation.shot)


@runtime_checkable
class _Report(Protocol):
    def __call__(self, done: int, /) -> None: ...


def _drawn(animation: Animation, both: Both) -> Iterator[tuple[Frame, Drawn | None]]:
    """Render frame after frame; one that repeats the frame before is not rendered again."""
    before: Frame | None = None
    drawn: Drawn | None = None
    for frame in animation:
        if before is None or not is_same_picture(before, frame):
            drawn = both.draw(frame)
        before = frame
        yield frame, drawn


def _pictures(job: Job, both: Both, measured: list[Light]) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
    reach, palettes = _reach(job.animation), Palettes(job.animation.puppet)
    for frame, drawn in _drawn(job.animation, both):
        if job.source is None:
            yield _alone(drawn, job.animation.size)
            continue
        picture = job.source.picture(frame.number)
        behind = None if job.behind is None else job.behind.picture(frame.t, picture, drawn)
        look = Look(measured[frame.t], reach)
        if job.over == "plate" and behind is not None:
            rgb = _over_plate(behind, drawn, look)
        else:
            rgb = picture if drawn is None else painted(picture, drawn, palettes, look, behind)
        yield np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])


def _alone(drawn: Drawn | None, size: tuple[int, int]) -> UInt8[np.ndarray, "H W 4"]:
    picture = np.zeros((size[1], size[0], 4), np.uint8)
    if drawn is not None:
        picture[drawn.window] = straight(drawn.after)
    return picture


def _over_plate(behind: UInt8[np.ndarray, "H W 3"], drawn: Drawn | None, look: Look) -> UInt8[np.ndarray, "H W 3"]:
    if drawn is None:
        return behind
    puppet = drawn.after * np.array([*look.light, 1.0], np.float32)
    whole = behind.copy()
    mixed = over(puppet, behind[drawn.window].astype(np.float32) / 255.0)
    whole[drawn.window] = np.rint(np.clip(mixed, 0.0, 1.0) * 255.0).astype(np.uint8)
    return whole


def _reach(animation: Animation) -> int:
    visible = np.flatnonzero(animation.is_visible)[::10]
    sides = [np.ptp(animation.vertices(int(t)), axis=0).max() for t in visible]
    return int(np.clip(round(REACH_SHARE * float(np.median(sides))) if sides else 0, LEAST_REACH, MOST_REACH))


def _written(
    pictures: Iterable[UInt8[np.ndarray, "H W 4"]], folder: Path, animation: Animation, report: _Report
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Write the pictures and pass them on as the preview shows them."""
    latest: list[UInt8[np.ndarray, "H W 4"]] = []

    def noted() -> Iterator[UInt8[np.ndarray, "H W 4"]]:
        for picture in pictures:
            latest[:] = [picture]
            yield picture

    for t in write_sequence(noted(), folder / FRAMES / "frame", int(animation.frames[0])):
        report(t + 1)
        yield _on_paper(latest[0])


def _on_paper(rgba: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 3"]:
    alpha = rgba[..., 3:].astype(np.float32) / 255.0
    return np.asarray(np.rint(rgba[..., :3] * alpha + PAPER * (1.0 - alpha)), np.uint8)
