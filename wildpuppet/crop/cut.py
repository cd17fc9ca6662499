"""Cutting crops out of the clip: the windows are laid now, pixels are read, warped and matted when asked."""

import numpy as np
from jaxtyping import Float, UInt8

from wildpuppet.crop.hold import go_along
from wildpuppet.crop.matte import Matter
from wildpuppet.crop.plate import learn_plates, plate_scale
from wildpuppet.crop.warp import cut_window, inside_image
from wildpuppet.crop.window import Windows, windows_of
from wildpuppet.errors import InputError
from wildpuppet.machine import Machine
from wildpuppet.settings import CropSettings
from wildpuppet.types import Clip, Crops, Target, Track
from wildpuppet.video.held import number_drawings
from wildpuppet.video.read import FrameReader

UNKNOWN = 128
# Held drawings are looked for in the boxes and this share of the largest side around them.
AROUND = 0.1


def cut(clip: Clip, track: Track, target: Target, settings: CropSettings, machine: Machine) -> Crops:
    """Cut a window around the character out of every tracked frame.

    ``images`` of the result reads the video when it is sliced; consecutive slices cost one pass, and nothing is kept.
    Pixels beyond the video repeat its edge and have matte 128 (unknown), as has everything when ``settings.matte``
    is off. Raises InputError where the track and the target do not belong together.
    """
    if not np.isin(target.at, track.frames):
        raise InputError(f"--at {target.at} is not among the tracked frames; track again with this range")
    reference = int(np.searchsorted(track.frames, target.at))
    windows = windows_of(track.boxes_video, track.shot, reference, settings)
    matter = None
    if settings.matte:
        scale = plate_scale(clip, track, 1.0 / float(windows.video_from_crop[reference, 0, 0]))
        survey, steps = learn_plates(clip, track, scale, machine)
        matter = Matter(track, survey, scale)
        if settings.hold_threshold > 0:
            windows = go_along(windows, steps, survey.plane_from_frame, scale)
    images = WindowImages(clip, track, windows, matter)
    box_crop = boxes_in_windows(track.boxes_video, windows.video_from_crop)
    drawing = number_drawings(BoxImages(images, box_crop), track.shot, settings.hold_threshold)
    return Crops(
        frames=track.frames,
        size=windows.size,
        video_from_crop=windows.video_from_crop,
        images=images,
        box_crop=box_crop,
        drawing=drawing,
        shot=track.shot,
        state=track.state,
        reference=reference,
    )


class WindowImages:
    """The crops of a clip as a lazy (T, H, W, 4) stack: colour from the video, alpha from the matte."""

    def __init__(self, clip: Clip, track: Track, windows: Windows, matter: Matter | None) -> None:
        self._clip, self._track, self._windows, self._matter = clip, track, windows, matter
        self._reader = FrameReader(clip)

    def __len__(self) -> int:
        return len(self._track.frames)

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        chosen = range(*index.indices(len(self)))
        width, height = self._windows.size
        result = np.empty((len(chosen), height, width, 4), np.uint8)
        for row, t in enumerate(chosen):
            frame = self._reader.frame(int(self._track.frames[t]))
            video_from_crop = self._windows.video_from_crop[t]
            result[row, ..., :3] = cut_window(frame, video_from_crop, self._windows.size)
            result[row, ..., 3] = self._matte(t, result[row, ..., :3], video_from_crop)
        return result

    def _matte(
        self, t: int, crop: UInt8[np.ndarray, "H W 3"], video_from_crop: Float[np.ndarray, "2 3"]
    ) -> UInt8[np.ndarray, "H W"]:
        size = self._windows.size
        if self._matter is None:
            return np.full((size[1], size[0]), UNKNOWN, np.uint8)
        matte = self._matter.matte(t, crop, video_from_crop)
        return np.where(inside_image(self._clip.size, video_from_crop, size), matte, UNKNOWN).astype(np.uint8)


class BoxImages:
    """The part of a stack that holds all boxes, with a little around them: what is compared to find held drawings."""

    def __init__(self, images: WindowImages, boxes: Float[np.ndarray, "T 4"]) -> None:
        by = AROUND * boxes[:, 2:].max()
        low = np.maximum(np.floor(boxes[:, :2].min(0) - by), 0).astype(int)
        high = np.ceil((boxes[:, :2] + boxes[:, 2:]).max(0) + by).astype(int)
        self._images = images
        self._part = slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))

    def __len__(self) -> int:
        return len(self._images)

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        return self._images[index][:, *self._part]


def boxes_in_windows(
    boxes_video: Float[np.ndarray, "T 4"], video_from_crop: Float[np.ndarray, "T 2 3"]
) -> Float[np.ndarray, "T 4"]:
    """Take boxes from video to crop pixels; the maps are pure scale and shift."""
    scale = video_from_crop[:, 0, 0, None]
    return np.concatenate([(boxes_video[:, :2] - video_from_crop[:, :, 2]) / scale, boxes_video[:, 2:] / scale], 1)
