"""A refiner, ready to use: poses of the puppet go in, pictures as they would have been drawn come out.

It keeps the drawings that it learnt from, for what they show is part of the answer (``texture.py``); the generator
corrects it. Both work at the crops' size; in a picture of another size the puppet is rendered there and their change
to the rendered crop is laid over it, so that what is sharp in the puppet stays sharp.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from wildpuppet.deform.learn import one_thread
from wildpuppet.errors import InputError, SettingsError
from wildpuppet.geometry import affine
from wildpuppet.machine import Machine
from wildpuppet.refine.examples import Examples, examples_of, usable_frames
from wildpuppet.refine.figure import Figure, scale_of
from wildpuppet.refine.inputs import BASE, look_for
from wildpuppet.refine.learn import Tell, corrected, correction_of, learn, quiet, split
from wildpuppet.refine.lesson import pairs_of
from wildpuppet.refine.network import Generator
from wildpuppet.refine.texture import Reach, Wardrobe, Weights, choose_weights
from wildpuppet.settings import RefineSettings
from wildpuppet.types import Crops, Fit, Puppet

BORDER = 8
"""Pixels around what a refined picture can reach."""
HAZE = 0.03
"""Alpha from 0, and up to 1, that counts as 0 and 1."""
MOST_SIDE = 3
"""A pose reaches at most so many times the larger side of the drawings."""


class Refined(NamedTuple):
    """One pose in a window of the crop: ``corner`` is its left top; premultiplied RGBA, 0..1."""

    corner: tuple[int, int]
    rendered: Float32[np.ndarray, "h w 4"]
    refined: Float32[np.ndarray, "h w 4"]


@dataclass(frozen=True, eq=False)
class Refiner:
    """What a refinement has learnt of one puppet.

    ``generator`` is None for the method "texture"; ``share`` of its correction is applied. ``hold_out`` are the frames
    that were kept from it. ``losses[name]`` is one number per step.
    """

    puppet: Puppet
    examples: Examples
    settings: RefineSettings
    weights: Weights
    generator: Generator | None = None
    share: float = 1.0
    hold_out: tuple[int, ...] = ()
    losses: Mapping[str, Float[np.ndarray, "S"]] = field(default_factory=dict)

    @cached_property
    def wardrobe(self) -> Wardrobe:
        """The drawings, ready to be looked up."""
        return Wardrobe(self.puppet, self.examples, reach_of(self.settings))

    def refine(self, vertices: Float[np.ndarray, "V 2"], order: Int[np.ndarray, "L"]) -> Refined:
        """Refine one pose, crop pixels of the drawings; it may lie outside the crop."""
        self._check(vertices, order)
        corner, size = self._window(vertices)
        found = self.wardrobe.find(vertices - corner, order, size=size)
        with one_thread():
            shown, look = look_for(found, self.weights, self.settings.method)
            refined = look.blended
            if self.generator is not None and self.settings.method != "texture":
                first = BASE[self.settings.method]
                correction = correction_of(self.generator, shown)
                refined = without_haze(corrected(shown[..., first : first + 4], correction, self.share))
        return Refined((int(corner[0]), int(corner[1])), found.drawn.rgba, refined)

    def _window(self, vertices: Float[np.ndarray, "V 2"]) -> tuple[Int[np.ndarray, "2"], tuple[int, int]]:
        """Find whole pixels around what a pose can show."""
        by = self.settings.beside * float(np.ptp(vertices, axis=0).max()) + BORDER
        low, high = np.floor(vertices.min(0) - by), np.ceil(vertices.max(0) + by)
        most = MOST_SIDE * max(self.examples.size)
        width, height = np.minimum(high - low, most).astype(int).tolist()
        return low.astype(np.int64), (width, height)

    def _check(self, vertices: Float[np.ndarray, "V 2"], order: Int[np.ndarray, "L"]) -> None:
        expected, layers = self.puppet.vertices.shape, self.puppet.num_layers
        if vertices.shape != expected or len(order) != layers:
            raise InputError(
                f"this refiner is another puppet's: expected {expected[0]} vertices in {layers} parts, "
                f"found {vertices.shape[0]} in {len(order)}"
            )
        if not np.isfinite(vertices).all():
            raise ValueError("vertices must be finite numbers")


def without_haze(picture: Float32[np.ndarray, "H W 4"]) -> Float32[np.ndarray, "H W 4"]:
    """Take away what is nearly transparent and close what is nearly opaque: a network never says quite 0 or 1."""
    alpha = picture[..., 3:]
    clear = ((alpha - HAZE) / (1.0 - 2.0 * HAZE)).clip(0.0, 1.0)
    return np.asarray(picture * (clear / np.maximum(alpha, HAZE)), np.float32)


class Finisher:
    """Draws refined poses in pictures of one size; a pose that is asked for again is not refined again.

    ``enlarged`` is picture pixels per crop pixel, as they mostly are: it chooses the texture's level.
    """

    def __init__(self, refiner: Refiner, size: tuple[int, int], enlarged: float = 1.0) -> None:
        self.refiner, self.size = refiner, size
        self._figure = Figure(refiner.puppet, size, enlarged * scale_of(refiner.puppet, refiner.examples.vertices))
        self._latest: tuple[bytes, Refined] | None = None

    def picture(
        self,
        vertices_crop: Float[np.ndarray, "V 2"],
        order: Int[np.ndarray, "L"],
        picture_from_crop: Float[np.ndarray, "2 3"],
    ) -> Float32[np.ndarray, "H W 4"]:
        """Draw one pose, crop pixels; premultiplied RGBA, 0..1."""
        vertices = np.array(vertices_crop, np.float64)
        name = vertices.tobytes() + np.array(order, np.int64).tobytes()
        if self._latest is None or self._latest[0] != name:
            self._latest = name, self.refiner.refine(vertices, order)
        rendered = self._figure.draw(affine.apply(picture_from_crop, vertices), order).rgba
        return corrected(rendered, placed(self._latest[1], picture_from_crop, self.size))


def refine_pictures(
    refiner: Refiner,
    vertices_crop: Float[np.ndarray, "N V 2"],
    order: Int[np.ndarray, "N L"],
    size: tuple[int, int] | None = None,
    picture_from_crop: Float[np.ndarray, "N 2 3"] | None = None,
) -> Iterator[Float32[np.ndarray, "H W 4"]]:
    """Draw poses as they would have been drawn: premultiplied RGBA, 0..1, one after the other.

    ``vertices_crop`` are crop pixels of the run that the refiner learnt from: their scale counts, their place does not.
    ``size`` (W, H) and ``picture_from_crop`` place the crop in the picture; left out, the picture is the crop.
    ``export.draw.straight`` makes 8 bits of them. Raises InputError for vertices of another puppet.
    """
    if (size is None) != (picture_from_crop is None):
        raise ValueError("expected both a size and a map from crop to picture, or neither")
    whole = np.repeat(np.eye(2, 3)[None], len(order), 0)
    maps = whole if picture_from_crop is None else picture_from_crop
    finisher = Finisher(refiner, size or refiner.examples.size, enlargement(maps))
    for vertices, layers, to_picture in zip(vertices_crop, order, maps, strict=True):
        yield finisher.picture(vertices, layers, to_picture)


def enlargement(maps: Float[np.ndarray, "N 2 3"]) -> float:
    """Give the middle scale of maps; 1 where there are none."""
    return float(np.median(np.sqrt(np.abs(np.linalg.det(maps[:, :, :2]))))) if len(maps) else 1.0


def placed(
    refined: Refined, picture_from_crop: Float[np.ndarray, "2 3"], size: tuple[int, int]
) -> Float32[np.ndarray, "H W 4"]:
    """Bring the change that refinement made into a picture; 0 beyond its window."""
    window = np.array(picture_from_crop, np.float64)
    window[:, 2] += window[:, :2] @ np.array(refined.corner, np.float64)
    change = refined.refined - refined.rendered
    return np.asarray(
        cv2.warpAffine(
            change, affine.for_opencv(window), size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
            borderValue=0,
        )
    )  # fmt: skip


def reach_of(settings: RefineSettings) -> Reach:
    """Take the settings that say where drawings are looked up."""
    return Reach(settings.neighbours, settings.beside)


def check_settings(settings: RefineSettings) -> None:
    """Raise SettingsError for settings that do not fit together."""
    step = 2**settings.depth
    if settings.method != "texture" and settings.patch % step:
        raise SettingsError(
            f"--patch {settings.patch}: expected a multiple of {step} (2 to the power of depth {settings.depth})"
        )


def refiner_of(
    puppet: Puppet,
    crops: Crops,
    fit: Fit,
    settings: RefineSettings,
    machine: Machine,
    hold_out: Collection[int] = (),
    checkpoint: Path | None = None,
    tell: Tell = quiet,
) -> Refiner:
    """Learn the look of a run's drawings, all but those of the frames ``hold_out``.

    ``crops`` have their pictures (``wildpuppet.recut``). A checkpoint that is there is gone on from. Raises InputError
    where there are too few drawings, StoreError for another training's checkpoint.
    """
    check_settings(settings)
    chosen = usable_frames(crops, fit, hold_out)
    examples = examples_of(puppet, crops, fit, chosen)
    wardrobe = Wardrobe(puppet, examples, reach_of(settings))
    weights, _ = choose_weights(wardrobe)
    held_out = tuple(sorted(set(hold_out)))
    if settings.method == "texture":
        machine.progress(1, 1)
        return Refiner(puppet, examples, settings, weights, hold_out=held_out)
    trained, validation = split(len(examples))
    pairs = pairs_of(wardrobe, weights, settings.method, range(len(examples)))
    seen, kept = ([pairs[index] for index in indices] for indices in (trained, validation))
    found = learn(seen, kept, settings, machine, checkpoint, tell)
    return Refiner(puppet, examples, settings, weights, found.generator, found.share, held_out, found.losses)
