"""How each value looks on disk: ``save_X(value, folder)`` and ``load_X(folder)`` for every value of ``types.py``.

Plain ``.npz`` files whose bytes depend on the values only (entries in a fixed order, stored, dated 1980), so that
writing twice gives the same file; words are unicode arrays, absent means None, nothing is pickled. Each file names its
schema and version. Arrays come back read-only. Pictures of crops go into a lossless video (``video/lossless.py``),
a cut-out into the folder that people edit (``puppet/folder.py``).
"""

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.errors import StoreError
from wildpuppet.types import Clip, Crops, CutOut, Fit, Followed, Hypotheses, Images, PointTracks, Poses, Puppet, Track

Arrays = dict[str, np.ndarray]

LOSSES = "losses."
PICTURES = "images.mkv"
PUPPET = "puppet"
FIRST_DATE = (1980, 1, 1, 0, 0, 0)


def write_arrays(path: Path, schema: str, arrays: Mapping[str, Any]) -> None:
    """Write an .npz that names its ``schema`` ("wildpuppet.NAME/VERSION"); the same arrays give the same bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name in ("schema", *sorted(arrays)):
            array = np.asarray(schema if name == "schema" else arrays[name])
            if array.dtype.hasobject:
                raise TypeError(f"{name}: arrays of objects cannot be written")
            info = zipfile.ZipInfo(f"{name}.npy", FIRST_DATE)
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array, order="C"), allow_pickle=False)


def read_arrays(path: Path, schema: str) -> Arrays:
    """Read what ``write_arrays`` wrote, read-only; raises StoreError for a damaged file or another schema."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise StoreError(f"{path}: cannot be read ({error}); run again with --redo to make it anew") from None
    found = str(arrays.pop("schema", "none"))
    if found != schema:
        raise StoreError(f"{path}: expected {schema}, found {found}; was it written by another wildpuppet version?")
    for array in arrays.values():
        array.flags.writeable = False
    return arrays


def words(array: np.ndarray) -> tuple[Any, ...]:
    """Turn a unicode array into a tuple of strings."""
    return tuple(str(word) for word in array)


def whole_numbers(array: np.ndarray) -> tuple[Any, ...]:
    """Turn an integer array into a tuple of ints."""
    return tuple(int(number) for number in array)


def _text(values: tuple[str, ...]) -> np.ndarray:
    return np.array(values, dtype=np.str_) if values else np.zeros(0, "<U1")


def save_clip(clip: Clip, folder: Path) -> None:
    """Write the frame table; the path is left out, because a moved video is the same clip."""
    base = clip.time_base
    write_arrays(
        folder / "clip.npz",
        "wildpuppet.clip/1",
        {
            "digest": clip.digest,
            "size": np.array(clip.size),
            "pts": clip.pts,
            "time_base": np.array([base.numerator, base.denominator]),
            "shot_starts": np.array(clip.shot_starts, dtype=np.int64),
            "bad_frames": np.array(clip.bad_frames, dtype=np.int64),
        },
    )


def load_clip(folder: Path) -> Clip:
    """Read the frame table; ``path`` is empty and the caller, who knows where the video is, replaces it."""
    arrays = read_arrays(folder / "clip.npz", "wildpuppet.clip/1")
    return Clip(
        path=Path(),
        digest=str(arrays["digest"]),
        size=whole_numbers(arrays["size"]),
        pts=arrays["pts"],
        time_base=Fraction(*whole_numbers(arrays["time_base"])),
        shot_starts=whole_numbers(arrays["shot_starts"]),
        bad_frames=whole_numbers(arrays["bad_frames"]),
    )


@dataclass(frozen=True, eq=False)
class NoPictures:
    """The pictures of crops whose video is not there; reading one raises StoreError."""

    length: int

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: slice, /) -> UInt8[np.ndarray, "n H W 4"]:
        raise StoreError("the crops' pictures are not here: run again to make them anew (the store was cleared)")


def save_crops(crops: Crops, folder: Path) -> None:
    """Write the windows and stream the pictures into a lossless video, a few at a time."""
    from wildpuppet.video.lossless import write_lossless

    write_lossless(folder / PICTURES, crops.images)
    save_windows(crops, folder)


def save_windows(crops: Crops, folder: Path) -> None:
    """Write all of the crops but their pictures."""
    named = {name: getattr(crops, name) for name in ("frames", "video_from_crop", "box_crop", "drawing", "shot")}
    known = {} if crops.reference is None else {"reference": np.array(crops.reference)}
    more = {"size": np.array(crops.size), "state": _text(crops.state), "ordered": np.array(crops.ordered)}
    write_arrays(folder / "crops.npz", "wildpuppet.crops/1", {**named, **more, **known})


def load_crops(folder: Path) -> Crops:
    """Read the windows; pictures are read when asked for, and raise StoreError then if they are not there."""
    arrays = read_arrays(folder / "crops.npz", "wildpuppet.crops/1")
    return Crops(
        frames=arrays["frames"],
        size=whole_numbers(arrays["size"]),
        video_from_crop=arrays["video_from_crop"],
        images=_pictures(folder / PICTURES, len(arrays["frames"])),
        box_crop=arrays["box_crop"],
        drawing=arrays["drawing"],
        shot=arrays["shot"],
        state=words(arrays["state"]),
        reference=int(arrays["reference"]) if "reference" in arrays else None,
        ordered=bool(arrays["ordered"]),
    )


def _pictures(path: Path, length: int) -> Images:
    if not path.exists():
        return NoPictures(length)
    from wildpuppet.video.lossless import VideoImages

    return VideoImages(path)


def save_cutout(cutout: CutOut, folder: Path) -> None:
    """Write the puppet folder that people edit."""
    from wildpuppet.puppet.folder import write_cutout

    write_cutout(cutout, folder / PUPPET)


def load_cutout(folder: Path) -> CutOut:
    """Read a puppet folder."""
    from wildpuppet.puppet.folder import read_cutout

    return read_cutout(folder / PUPPET)


def save_puppet(puppet: Puppet, folder: Path) -> None:
    """Write the built mesh."""
    arrays = {field.name: getattr(puppet, field.name) for field in fields(Puppet)}
    arrays |= {"names": _text(puppet.names), "canvas": np.array(puppet.canvas)}
    if arrays["reference"] is None:
        del arrays["reference"]
    write_arrays(folder / "puppet.npz", "wildpuppet.mesh/1", arrays)


def load_puppet(folder: Path) -> Puppet:
    """Read a built mesh."""
    arrays: dict[str, Any] = {**read_arrays(folder / "puppet.npz", "wildpuppet.mesh/1")}
    arrays |= {"names": words(arrays["names"]), "canvas": whole_numbers(arrays["canvas"])}
    arrays["reference"] = int(arrays["reference"]) if "reference" in arrays else None
    return Puppet(**arrays)


def save_track(track: Track, folder: Path) -> None:
    """Write the boxes."""
    arrays = {field.name: getattr(track, field.name) for field in fields(Track)}
    write_arrays(folder / "track.npz", "wildpuppet.track/1", arrays | {"state": _text(track.state)})


def load_track(folder: Path) -> Track:
    """Read the boxes."""
    arrays: dict[str, Any] = {**read_arrays(folder / "track.npz", "wildpuppet.track/1")}
    return Track(**arrays | {"state": words(arrays["state"])})


def save_fit(fit: Fit, folder: Path) -> None:
    """Write the fitted vertices, order, confidence, states and losses."""
    arrays = {name: getattr(fit, name) for name in ("frames", "vertices_crop", "order", "confidence")}
    losses = {f"{LOSSES}{name}": values for name, values in fit.losses.items()}
    write_arrays(folder / "fit.npz", "wildpuppet.fit/1", {**arrays, **losses, "state": _text(fit.state)})


def load_fit(folder: Path) -> Fit:
    """Read a fit."""
    arrays = read_arrays(folder / "fit.npz", "wildpuppet.fit/1")
    losses = {name.removeprefix(LOSSES): arrays.pop(name) for name in sorted(arrays) if name.startswith(LOSSES)}
    values: dict[str, Any] = {**arrays}
    return Fit(**values | {"state": words(arrays["state"]), "losses": losses})


def _plain(kind: type[Any], name: str) -> tuple[Callable[[Any, Path], None], Callable[[Path], Any]]:
    """Give save and load of a dataclass whose fields are all arrays."""
    schema = f"wildpuppet.{name}/1"

    def save(value: Any, folder: Path) -> None:
        write_arrays(folder / f"{name}.npz", schema, {field.name: getattr(value, field.name) for field in fields(kind)})

    def load(folder: Path) -> Any:
        return kind(**read_arrays(folder / f"{name}.npz", schema))

    return save, load


save_poses, load_poses = _plain(Poses, "poses")
save_hypotheses, load_hypotheses = _plain(Hypotheses, "hypotheses")
save_followed, load_followed = _plain(Followed, "followed")
save_points, load_points = _plain(PointTracks, "points")


def save_placement(crop_from_canvas: Float[np.ndarray, "*T 2 3"], folder: Path) -> None:
    """Write the rest placement."""
    write_arrays(folder / "placement.npz", "wildpuppet.placement/1", {"crop_from_canvas": crop_from_canvas})


def load_placement(folder: Path) -> Float[np.ndarray, "*T 2 3"]:
    """Read the rest placement."""
    return read_arrays(folder / "placement.npz", "wildpuppet.placement/1")["crop_from_canvas"]


def save_numbers(numbers: Int[np.ndarray, "T"], folder: Path) -> None:
    """Write the number of each frame's drawing."""
    write_arrays(folder / "numbers.npz", "wildpuppet.numbers/1", {"drawing": numbers})


def load_numbers(folder: Path) -> Int[np.ndarray, "T"]:
    """Read the number of each frame's drawing."""
    return read_arrays(folder / "numbers.npz", "wildpuppet.numbers/1")["drawing"]


def save_files(write: Callable[[Path], None], folder: Path) -> None:
    """Let a value that is a set of files (meshes, a preview) write itself."""
    write(folder)


def load_folder(folder: Path) -> Path:
    """Give the folder itself: its files are the value."""
    return folder
