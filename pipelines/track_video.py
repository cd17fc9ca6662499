"""The main job: a video and a box around a character -> a puppet mesh in every frame. Reads top to bottom.

probe -> (puppet) -> track -> crop -> puppet -> hinges -> search -> choose -> fit -> exposure, meshes, preview -> OUT
"""

from pathlib import Path

from wildpuppet import stages
from wildpuppet.runs import check_out, check_puppet_unedited
from wildpuppet.store import Kept
from wildpuppet.types import Clip, Crops, Puppet, Target

from .fit_frames import Frames, fit_frames, with_learnt_hinges
from .keeper import Keeper
from .keyframes import given_keyframes
from .outcome import Outcome
from .request import Request, at_path, given_cutout, given_target, given_video, target_of


def track_video(keeper: Keeper, request: Request) -> Outcome:
    """Run every stage that is not kept."""
    check_out(request.out)
    clip = keeper.keep(stages.PROBE, video=given_video(request.source)).then(at_path(request.source))
    frames_wanted = target_of(request, clip.value)
    target = given_target(frames_wanted)
    puppet = given_puppet(keeper, request.puppet)
    keyframes = given_keyframes(request, frames_wanted, puppet)
    track = keeper.keep(stages.TRACK, clip=clip, target=target)
    crops = keeper.keep(stages.CROP, clip=clip, track=track, target=target)
    if puppet is None:
        puppet = automatic_puppet(keeper, clip, crops, target, request.out)
        keyframes = given_keyframes(request, frames_wanted, puppet)
    frames = Frames(frames_wanted.end - frames_wanted.start, frames_wanted.at - frames_wanted.start)
    puppet = with_learnt_hinges(keeper, puppet, crops)
    fit = fit_frames(keeper, puppet, crops, frames, keyframes)
    numbers = keeper.keep(stages.REUSE, crops=crops)
    exposure = keeper.keep(stages.EXPOSURE, clip=clip, crops=crops, fit=fit, numbers=numbers)
    meshes = keeper.keep(stages.MESHES, clip=clip, puppet=puppet, crops=crops, fit=fit)
    preview = None
    if keeper.settings.out.preview:
        preview = keeper.keep(stages.PREVIEW, source=clip, puppet=puppet, crops=crops, fit=fit)
    return Outcome(clip.value.size, puppet, crops, fit, numbers, exposure, meshes, preview)


def given_puppet(keeper: Keeper, folder: Path | None) -> Kept[Puppet] | None:
    """Build the given puppet before the slow stages, so that what is wrong with it is told at once."""
    if folder is None:
        return None
    return keeper.keep(stages.PUPPET, cutout=given_cutout(folder))


def automatic_puppet(
    keeper: Keeper, clip: Kept[Clip], crops: Kept[Crops], target: Kept[Target], out: Path
) -> Kept[Puppet]:
    """Make a puppet from the reference frame; one that was corrected by hand in OUT is not written over."""
    check_puppet_unedited(out)
    cutout = keeper.keep(stages.AUTOMATIC, clip=clip, crops=crops, target=target)
    return keeper.keep(stages.PUPPET, cutout=cutout)
