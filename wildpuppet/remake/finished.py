"""Inbetweens as they would have been drawn: a refiner draws each rendered frame anew."""

import numpy as np
from jaxtyping import UInt8

from wildpuppet.export.draw import straight
from wildpuppet.geometry.affine import apply, compose, invert
from wildpuppet.refine.refiner import Finisher, Refiner, enlargement
from wildpuppet.remake.contact import Finish
from wildpuppet.remake.inbetween import Inbetweens
from wildpuppet.runs import RunFolder


def finish_with(refiner: Refiner, run: RunFolder, found: Inbetweens, first: int) -> Finish:
    """Give what turns a rendered frame into a finished one; ``first`` is the first key's frame in the run.

    The refiner knows drawings at the scale of the run's windows: poses go to the first key's window and back.
    """
    row = int(np.flatnonzero(run.fit.frames == first)[0])
    video_from_crop = run.crops.video_from_crop[row].astype(np.float64)
    picture_from_crop = compose(found.picture_from_video, video_from_crop)
    crop_from_picture = invert(picture_from_crop)
    finisher = Finisher(refiner, found.posed.size, enlargement(picture_from_crop[None]))
    fit = found.posed.fit

    def finish(t: int, rendered: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 4"]:
        vertices = apply(crop_from_picture, fit.vertices_crop[t])
        return straight(finisher.picture(vertices, fit.order[t], picture_from_crop))

    return finish
