"""A first look through the range: how the camera moves, and what the background of each shot is.

One pass over small pictures; a few evenly spread ones per shot are kept until the shot ends and make its plate.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.track.camera import Camera
from wildpuppet.track.plate import Plate, median_plate

# Pictures that a shot's plate is made of, at most and at least; more is surer and takes more memory.
MOST_SAMPLES, LEAST_SAMPLES = 32, 6


@dataclass(frozen=True, eq=False)
class Survey:
    """``plane_from_frame`` per frame of the range (the plane is the first picture of the shot) and a plate per shot.

    ``samples`` are the pictures that each plate is made of, by their row in the range.
    """

    plane_from_frame: Float[np.ndarray, "T 2 3"]
    shot: Int[np.ndarray, " T"]
    plates: dict[int, Plate]
    samples: dict[int, dict[int, UInt8[np.ndarray, "a b 3"]]]


def samples_per_shot(shot: Int[np.ndarray, " T"], in_all: int, most: int = MOST_SAMPLES) -> int:
    """Share a number of pictures out among the shots."""
    return int(np.clip(in_all // max(len(np.unique(shot)), 1), LEAST_SAMPLES, most))


def survey(
    pictures: Iterator[UInt8[np.ndarray, "a b 3"]],
    shot: Int[np.ndarray, " T"],
    covered: Callable[[int], UInt8[np.ndarray, "a b"] | None],
    progress: Callable[[int], None],
    num_samples: int,
) -> Survey:
    """Look at every picture once; ``covered(t)`` is non-zero where the character is in picture t, None: unknown."""
    plane_from_frame = np.empty((len(shot), 2, 3))
    plates: dict[int, Plate] = {}
    kept: dict[int, dict[int, UInt8[np.ndarray, "a b 3"]]] = {}
    camera, samples = Camera(), Samples(num_samples)
    for t, picture in enumerate(pictures):
        if t and shot[t] != shot[t - 1]:
            plates[int(shot[t - 1])], kept[int(shot[t - 1])] = samples.plate(), samples.pictures()
            camera, samples = Camera(), Samples(num_samples)
        hidden = covered(t)
        visible = np.full(picture.shape[:2], 255, np.uint8) if hidden is None else 255 * (hidden == 0).astype(np.uint8)
        plane_from_frame[t] = camera.step(
            cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), None if hidden is None else visible
        )
        samples.offer(t, picture, visible, plane_from_frame[t])
        progress(t + 1)
    plates[int(shot[-1])], kept[int(shot[-1])] = samples.plate(), samples.pictures()
    return Survey(plane_from_frame, shot, plates, kept)


class Samples:
    """Keeps at most ``most`` evenly spread pictures of a stream whose length is not known."""

    def __init__(self, most: int) -> None:
        self.most, self.step, self.seen = most, 1, 0
        self.kept: list[tuple[int, UInt8[np.ndarray, "a b 3"], UInt8[np.ndarray, "a b"], Float[np.ndarray, "2 3"]]] = []

    def offer(
        self,
        t: int,
        picture: UInt8[np.ndarray, "a b 3"],
        visible: UInt8[np.ndarray, "a b"],
        plane_from_frame: Float[np.ndarray, "2 3"],
    ) -> None:
        """Look at the next picture; keep every ``step``-th, and thin them out when there are too many."""
        if self.seen % self.step == 0:
            self.kept.append((t, picture, visible, plane_from_frame))
            if len(self.kept) > self.most:
                self.kept = self.kept[::2]
                self.step *= 2
        self.seen += 1

    def plate(self) -> Plate:
        """Make the plate of what was kept."""
        _, pictures, visible, maps = zip(*self.kept, strict=True)
        return median_plate(pictures, visible, np.stack(maps))

    def pictures(self) -> dict[int, UInt8[np.ndarray, "a b 3"]]:
        """Return what was kept, by number."""
        return {t: picture for t, picture, _, _ in self.kept}
