"""What a run was asked for, and how the outside world (files, boxes) becomes inputs that have a digest."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from wildpuppet.errors import InputError
from wildpuppet.settings import Settings, settings_from
from wildpuppet.store import Kept, digest_of, digest_of_file, given
from wildpuppet.types import Clip, CutOut, Target


@dataclass(frozen=True)
class Request:
    """One run: a video with a box (``box_video``, x y w h in frame ``at``), or a folder of drawings with a puppet."""

    source: Path
    out: Path
    settings: Settings
    puppet: Path | None = None
    box_video: tuple[float, float, float, float] | None = None
    at: int | None = None
    start: int = 0
    end: int | None = None
    test_share: float = 0.0
    keyframes: tuple[tuple[int, Path], ...] = ()
    """Frames and the files that say what is fixed in them."""
    test_frames: tuple[int, ...] = ()
    """The drawings that no training sees, in order; given, they stand for ``test_share``."""

    def plain(self) -> dict[str, Any]:
        """Write it as plain values for run.json; ``out`` is left out, because a run can be moved."""
        tree: dict[str, Any] = {
            "source": str(self.source.absolute()),
            "puppet": None if self.puppet is None else str(self.puppet.absolute()),
            "settings": msgspec.to_builtins(self.settings),
        }
        tree |= {name: getattr(self, name) for name in ("box_video", "at", "start", "end", "test_share")}
        if self.keyframes:
            tree["keyframes"] = [[frame, str(path.absolute())] for frame, path in self.keyframes]
        if self.test_frames:
            tree["test_frames"] = list(self.test_frames)
        return tree

    @property
    def note_name(self) -> str:
        """Name of the store's note about this run: one per OUT folder and request."""
        return f"{digest_of(str(self.out.absolute()))[:12]}-{digest_of(self.plain())[:12]}"


def request_from(tree: Mapping[str, Any], out: Path) -> Request:
    """Read back what ``Request.plain`` wrote."""
    values = dict(tree)
    values |= {"source": Path(values["source"]), "settings": settings_from(values["settings"])}
    values["puppet"] = None if values["puppet"] is None else Path(values["puppet"])
    values["box_video"] = None if values["box_video"] is None else tuple(values["box_video"])
    values["keyframes"] = tuple((frame, Path(path)) for frame, path in values.get("keyframes", ()))
    values["test_frames"] = tuple(values.get("test_frames", ()))
    return Request(out=out, **values)


def target_of(request: Request, clip: Clip) -> Target:
    """Resolve box, reference frame and range; raises InputError in words for what lies outside the clip."""
    assert request.box_video is not None, "a run on a video has a box"
    end = clip.num_frames if request.end is None else request.end
    start = request.start
    if not 0 <= start < min(end, clip.num_frames):
        raise InputError(
            f"no frames in range: --start {start} --end {end} of a clip with frames 0 to {clip.num_frames - 1}; "
            "the range is START <= frame < END"
        )
    if end > clip.num_frames:
        raise InputError(f"--end {end}: the clip has {clip.num_frames} frames; give at most --end {clip.num_frames}")
    at = start if request.at is None else request.at
    if not start <= at < end:
        raise InputError(f"--at {at}: expected a frame of the range {start} to {end - 1}, where the box is given")
    _check_inside(request.box_video, clip.size)
    return Target(request.box_video, at, start, end)


def check_box(box: tuple[float, float, float, float]) -> None:
    """Raise InputError for a box that is none in any picture."""
    x, y, width, height = box
    if not all(map(math.isfinite, box)):
        raise InputError(f"--bbox {x:g},{y:g},{width:g},{height:g}: expected four numbers X,Y,W,H in pixels")
    if not (width > 0 and height > 0):
        raise InputError(
            f"--bbox {x:g},{y:g},{width:g},{height:g}: the box has no area; expected X,Y,W,H with W, H > 0"
        )


def _check_inside(box: tuple[float, float, float, float], size: tuple[int, int]) -> None:
    x, y, width, height = box
    if x >= size[0] or y >= size[1] or x + width <= 0 or y + height <= 0:
        raise InputError(
            f"--bbox {x:g},{y:g},{width:g},{height:g}: the box lies outside the frame, which is {size[0]} x {size[1]}"
        )


def given_video(path: Path) -> Kept[Path]:
    """Take a video file by the digest of its bytes."""
    if not path.is_file():
        found = "a folder (wildpuppet fit reads folders of drawings)" if path.is_dir() else "no such file"
        raise InputError(f"{path}: expected a video file, found {found}; check the path")
    try:
        return given(path, digest_of_file(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None


def given_target(target: Target) -> Kept[Target]:
    """Take a target by its values."""
    return given(target, asdict(target))


def at_path(path: Path) -> Any:
    """Give the function that adds the video's path to a clip that came out of the store."""

    def add(clip: Clip) -> Clip:
        return replace(clip, path=path)

    return add


def given_cutout(folder: Path) -> Kept[CutOut]:
    """Take a puppet folder by the digest of puppet.json and the pictures beside it; ``overlay.png`` is ours."""
    from wildpuppet.puppet.folder import read_cutout

    files = [folder / "puppet.json", *sorted(folder.rglob("*.png"))]
    known = {
        path.relative_to(folder).as_posix(): digest_of_file(path)
        for path in files
        if path.is_file() and path.name != "overlay.png"
    }
    if "puppet.json" not in known:
        read_cutout(folder)  # says in words what is missing
    return Kept(digest_of(known), lambda: read_cutout(folder))


@dataclass(frozen=True)
class Drawings:
    """A folder of drawings: file names in order and the canvas (W, H)."""

    folder: Path
    names: tuple[str, ...]
    size: tuple[int, int]


def given_drawings(folder: Path) -> Kept[Drawings]:
    """Take a folder of drawings by the names and digests of its pictures."""
    from wildpuppet.video.drawings import read_drawings

    names, images = read_drawings(folder)
    height, width = images[:1].shape[1:3]
    digest = digest_of({name: digest_of_file(folder / name) for name in names})
    return given(Drawings(folder, tuple(names), (width, height)), digest)
