"""Finishing a run: every frame as it would have been drawn, with alpha, alone or over the background.

OUT/frames/     frame.NNNNN.png (numbers of the clip), preview.mp4, manifest.json
OUT/refiner/    what was learnt, for `wildpuppet inbetween --refine` and other runs of the puppet
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float32, UInt8
from PIL import Image

from wildpuppet import atomic
from wildpuppet.errors import InputError
from wildpuppet.export.animation import Frame
from wildpuppet.export.draw import straight
from wildpuppet.export.export import check_unedited
from wildpuppet.export.manifest import MANIFEST, Manifest, write_manifest
from wildpuppet.export.png import numbered, write_sequence
from wildpuppet.export.source import Source, over_white, source_of
from wildpuppet.machine import Progress, silent
from wildpuppet.paint.behind import background_of_run
from wildpuppet.paint.compose import over as laid_over
from wildpuppet.paint.layers import Drawn
from wildpuppet.paint.paint import Background
from wildpuppet.recut import place_of_run, run_crops
from wildpuppet.refine.examples import examples_of
from wildpuppet.refine.refiner import Finisher, Refiner, enlargement, refine_pictures
from wildpuppet.refine.texture import on_white
from wildpuppet.runs import RunFolder
from wildpuppet.types import Clip
from wildpuppet.video.write import write_preview

Over = Literal["none", "plate", "white"]

FRAMES, REFINER, PREVIEW = "frames", "refiner", "preview.mp4"
FORMAT = "refine"
BATCH = 16


def check_finish_out(out: Path) -> None:
    """Raise InputError where ``out`` holds anything but an unchanged earlier result of ours."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: expected a folder, found a file; give another one")
    for item in sorted(out.iterdir()) if out.is_dir() else ():
        if item.name not in (FRAMES, REFINER) and not item.name.startswith(atomic.PREFIX):
            raise InputError(f"--out {out}: holds other files ({item.name}); give a new or an empty folder")
    if (out / FRAMES).exists() and not (out / FRAMES / MANIFEST).is_file():
        raise InputError(f"--out {out}: its frames are not ours (no {MANIFEST}); give a new or an empty folder")
    check_unedited(out / FRAMES)


def finish_run(
    run: RunFolder,
    refiner: Refiner,
    out: Path,
    over: Over = "none",
    source: Path | None = None,
    progress: Progress = silent,
) -> Path:
    """Draw every frame of a run into OUT/frames, whole or not at all; an unchanged earlier result is replaced.

    ``over``: "none" (transparent around the character), "plate" (the background without the character; white paper for
    drawings) or "white". ``source`` is where the clip lies now, when it was moved; only "plate" needs it.
    """
    check_finish_out(out)
    animation = run.animation
    if not len(animation):
        raise InputError(f"{run.folder}: expected a run with frames, found none; run it on a longer range")
    place = place_of_run(run, source) if over == "plate" else None
    with atomic.disk_errors(out), atomic.new_folder(out) as beside:
        folder = beside / FRAMES
        stem, first = folder / "frame", int(animation.frames[0])
        for t in write_sequence(_pictures(run, refiner, over, place), stem, first):
            progress(t + 1, len(animation))
        paths = [numbered(stem, first + t) for t in range(len(animation))]
        write_preview(folder / PREVIEW, _shown(paths), animation.timing.pts, animation.timing.time_base)
        said = Manifest("top left corner of the picture", "x right, y down", first)
        write_manifest(folder, FORMAT, animation, said)
        if (out / FRAMES).exists():
            (out / FRAMES).rename(beside / "replaced")
        folder.rename(out / FRAMES)
    return out / FRAMES


def errors_of(
    refiner: Refiner, run: RunFolder, frames: Collection[int], source: Path | None = None
) -> tuple[float, float]:
    """Measure the rendered puppet and the refined one against drawings: mean squared errors.

    The mean over the crop's pixels and three colours, 0..255, everything over white, then over the drawings. In clips
    the drawing is what the matte says is the character. Lost frames are left out. The usual mistake: frames that the
    refiner has learnt from.
    """
    wanted = [t for t in range(len(run.fit.frames)) if int(run.fit.frames[t]) in set(frames)]
    wanted = [t for t in wanted if run.fit.state[t] != "lost"]
    if not wanted:
        raise InputError("expected frames of the run in which the character is not lost, found none")
    crops = run_crops(run, source, with_matte=True)
    found: list[tuple[float, float]] = []
    for start in range(0, len(wanted), BATCH):
        drawings = examples_of(run.puppet, crops, run.fit, np.array(wanted[start : start + BATCH]))
        pictures = refine_pictures(refiner, drawings.vertices, drawings.order)
        for index, picture in enumerate(pictures):
            rendered = refiner.wardrobe.figure.draw(drawings.vertices[index], drawings.order[index]).rgba
            truth = on_white(drawings.picture(index))
            found.append((_squared(on_white(rendered), truth), _squared(on_white(picture), truth)))
    rendered_error, refined_error = np.mean(found, 0).tolist()
    return rendered_error, refined_error


def _squared(picture: Float32[np.ndarray, "H W 3"], truth: Float32[np.ndarray, "H W 3"]) -> float:
    return float(255.0**2 * ((picture - truth) ** 2).mean())


def _pictures(
    run: RunFolder, refiner: Refiner, over: Over, place: Clip | Path | None
) -> Iterator[UInt8[np.ndarray, "H W 4"]]:
    """Draw frame after frame, straight RGBA."""
    finisher = Finisher(refiner, run.size, enlargement(run.crops.video_from_crop))
    source = None if place is None else source_of(place)
    behind = None if place is None else background_of_run(run, place)
    for frame in run.animation:
        finished = _finished(run, finisher, frame)
        if source is None or behind is None:
            yield _opaque(over_white(straight(finished))) if over == "white" else straight(finished)
        else:
            yield _opaque(_over_plate(finished, frame, source, behind))


def _finished(run: RunFolder, finisher: Finisher, frame: Frame) -> Float32[np.ndarray, "H W 4"]:
    """Draw one frame, premultiplied; nothing where the character is lost."""
    if not frame.is_visible:
        return np.zeros((finisher.size[1], finisher.size[0], 4), np.float32)
    vertices = run.fit.vertices_crop[frame.t]
    return finisher.picture(vertices, frame.order, run.crops.video_from_crop[frame.t])


def _over_plate(
    finished: Float32[np.ndarray, "H W 4"], frame: Frame, source: Source, behind: Background
) -> UInt8[np.ndarray, "H W 3"]:
    picture = source.picture(frame.number)
    whole = slice(0, picture.shape[0]), slice(0, picture.shape[1])
    covered = finished[..., 3] > 0.0
    drawn = Drawn(whole, finished, finished, np.where(covered, 0, -1), covered) if frame.is_visible else None
    plate = behind.picture(frame.t, picture, drawn)
    mixed = laid_over(finished, plate.astype(np.float32) / 255.0)
    return np.asarray(np.rint(mixed.clip(0.0, 1.0) * 255.0), np.uint8)


def _opaque(rgb: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 4"]:
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])


def _shown(paths: Sequence[Path]) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Read the frames back as the preview shows them."""
    for path in paths:
        with Image.open(path) as image:
            yield over_white(np.asarray(image.convert("RGBA")))
