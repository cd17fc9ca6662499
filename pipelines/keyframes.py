"""Keyframes on the command line: FRAME:FILE, and how their files become inputs that have a digest."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from wildpuppet.errors import InputError, SettingsError
from wildpuppet.store import Kept, digest_of_file
from wildpuppet.types import Keyframe, Puppet, Target

from .request import Request


def keyframes_from(words: Sequence[str]) -> tuple[tuple[int, Path], ...]:
    """Read FRAME:FILE, as ``--keyframe`` takes them; raises InputError for anything else."""
    found: dict[int, Path] = {}
    for word in words:
        frame, colon, path = word.partition(":")
        if not (colon and path and frame.strip().isdecimal()):
            raise InputError(f"--keyframe {word}: expected FRAME:FILE, as in --keyframe 120:points.csv")
        if int(frame) in found:
            raise InputError(
                f"--keyframe {word}: frame {int(frame)} has one already; put all of its points in one file"
            )
        found[int(frame)] = Path(path)
    return tuple(sorted(found.items()))


def given_keyframes(request: Request, target: Target, puppet: Kept[Puppet] | None) -> dict[int, Kept[Keyframe]]:
    """Take what is fixed by the digests of its files, in the order of the frames: index -> keyframe.

    Where the puppet is known the files are read at once, so that what is wrong with them is told before the slow
    stages. Raises InputError for a frame that the run does not have and for a file that says nothing.
    """
    if request.keyframes:
        _check_settings(request)
    found: dict[int, Kept[Keyframe]] = {}
    for frame, path in request.keyframes:
        flag = f"--keyframe {frame}:{path}"
        if not target.start <= frame < target.end:
            raise InputError(f"{flag}: expected a frame of the range {target.start} to {target.end - 1}")
        if not path.is_file():
            raise InputError(f"{flag}: expected a csv or npz file, found none; check the path")
        keyframe = Kept([frame, digest_of_file(path)], partial(_read, path, frame, puppet))
        found[frame - target.start] = keyframe
        if puppet is not None and puppet.digest is not None:
            _ = keyframe.value
    return found


def _check_settings(request: Request) -> None:
    if not request.settings.search.enabled or request.settings.fit.method != "descent":
        raise SettingsError(
            "--keyframe: expected search.enabled true and fit.method descent, which keep to it; "
            "leave out the preset or the setting that says otherwise"
        )


def _read(path: Path, frame: int, puppet: Kept[Puppet] | None) -> Keyframe:
    from wildpuppet.pose.keyframes import read_keyframe

    assert puppet is not None, "keyframes are read once there is a puppet"
    return read_keyframe(path, frame, puppet.value)
