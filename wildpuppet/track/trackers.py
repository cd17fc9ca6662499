"""OpenCV's single-object trackers behind one small interface.

CSRT, KCF and MIL need nothing; Nano, Vit and DaSiamRPN are neural and need the user's model files. A tracker's own
"found" flag is unreliable for most of them, so callers judge each box themselves (``appearance.py``). Boxes are
x, y, w, h in the pixels of the images that are given; OpenCV rounds them to whole pixels. Images are BGR, uint8.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8

from wildpuppet.errors import SettingsError
from wildpuppet.settings import TrackSettings

# The stubs that come with OpenCV leave its trackers out.
contrib: Any = cv2

Box = tuple[float, float, float, float]

# CSRT's filter works on the target scaled to about this many pixels a side, and tries so many sizes. OpenCV's own 200
# and 33 are three times slower; sizes are measured against the background anyhow (``extent.py``), as is what its
# segmentation would tell. On clips with known boxes the overlap is the same to half a point.
CSRT_TEMPLATE_SIZE, CSRT_NUM_SCALES = 80.0, 9

MODEL_FILES = {
    "nano": ("the backbone (.onnx)", "the neck and head (.onnx)"),
    "vit": ("the network (.onnx)",),
    "dasiamrpn": ("the network (.onnx)", "kernel_cls1 (.onnx)", "kernel_r1 (.onnx)"),
}


@runtime_checkable
class OpenCVTracker(Protocol):
    """What all of OpenCV's trackers do."""

    def init(self, image: UInt8[np.ndarray, "H W 3"], box: tuple[int, int, int, int], /) -> None:
        """Learn the target from an image and its box."""

    def update(self, image: UInt8[np.ndarray, "H W 3"], /) -> tuple[bool, tuple[int, int, int, int]]:
        """Return whether it was found, and where, in the next image."""
        ...


def make_tracker(settings: TrackSettings) -> Callable[[], OpenCVTracker]:
    """Return a function that makes fresh trackers of ``settings.method``.

    Raises SettingsError where a method needs model files that were not given or do not exist.
    """
    files = model_files(settings)
    makers: dict[str, Callable[[], OpenCVTracker]] = {
        "csrt": make_csrt,
        "kcf": contrib.TrackerKCF_create,
        "mil": contrib.TrackerMIL_create,
        "nano": lambda: make_nano(files),
        "vit": lambda: make_vit(files),
        "dasiamrpn": lambda: make_dasiamrpn(files),
    }
    make = makers[settings.method]
    if files:
        check_readable(make, settings)
    return make


def check_readable(make: Callable[[], OpenCVTracker], settings: TrackSettings) -> None:
    """Raise SettingsError where OpenCV cannot read the model files."""
    try:
        make()
    except cv2.error as error:
        reason = str(error).strip().splitlines()[0]
        raise SettingsError(
            f"track.model {settings.model}: expected the ONNX files of {settings.method}, OpenCV cannot read them "
            f"({reason}); give the files that OpenCV's documentation of Tracker{settings.method.title()} links to"
        ) from None


def model_files(settings: TrackSettings) -> tuple[str, ...]:
    """Check and return the model files that ``settings.method`` needs; () for CSRT, KCF and MIL."""
    wanted = MODEL_FILES.get(settings.method, ())
    if not wanted:
        return ()
    given = tuple(name.strip() for name in settings.model.split(",") if name.strip())
    if len(given) != len(wanted):
        raise SettingsError(
            f"track.method {settings.method} needs {len(wanted)} model file(s), found {len(given)}: "
            f"give track.model {', '.join(wanted)}, comma-separated, or use track.method csrt"
        )
    for name, meaning in zip(given, wanted, strict=True):
        if not Path(name).is_file():
            expected = f"track.model: expected {meaning} of {settings.method}"
            raise SettingsError(f"{expected}, found no file {name}; correct the path")
    return given


def make_csrt() -> OpenCVTracker:
    """Make OpenCV's discriminative correlation filter with channel and spatial reliability."""
    params = contrib.TrackerCSRT_Params()
    params.template_size, params.number_of_scales = CSRT_TEMPLATE_SIZE, CSRT_NUM_SCALES
    params.use_segmentation = False
    tracker: OpenCVTracker = contrib.TrackerCSRT_create(params)
    return tracker


def make_nano(files: tuple[str, ...]) -> OpenCVTracker:
    """Make NanoTrack from its two networks."""
    params = contrib.TrackerNano_Params()
    params.backbone, params.neckhead = files
    tracker: OpenCVTracker = contrib.TrackerNano_create(params)
    return tracker


def make_vit(files: tuple[str, ...]) -> OpenCVTracker:
    """Make VitTrack from its network."""
    params = contrib.TrackerVit_Params()
    (params.net,) = files
    tracker: OpenCVTracker = contrib.TrackerVit_create(params)
    return tracker


def make_dasiamrpn(files: tuple[str, ...]) -> OpenCVTracker:
    """Make DaSiamRPN from its three networks."""
    params = contrib.TrackerDaSiamRPN_Params()
    params.model, params.kernel_cls1, params.kernel_r1 = files
    tracker: OpenCVTracker = contrib.TrackerDaSiamRPN_create(params)
    return tracker
