"""What there is to paint on: the puppet's texture as a folder of part pictures, or as a layered PSD or ORA."""

from pathlib import Path

import numpy as np
from PIL import Image

from wildpuppet.errors import InputError
from wildpuppet.export.ora import write_ora
from wildpuppet.export.psd import write_psd
from wildpuppet.export.sprites import merged, sprites_at_rest
from wildpuppet.export.whole import whole_file
from wildpuppet.paint.texture import canvas_pictures
from wildpuppet.puppet.folder import write_cutout
from wildpuppet.types import CutOut, JointSpec, Part, Puppet

FLAT = "picture.png"
LAYERED = {".psd": write_psd, ".ora": write_ora}


def write_template(puppet: Puppet, place: Path) -> None:
    """Write PLACE: a layered file where its name ends in .psd or .ora, else a puppet folder and a flat picture.png.

    Raises InputError where something is there already.
    """
    if place.exists():
        raise InputError(f"--template {place}: already exists; choose another name, it may be painted on")
    write = LAYERED.get(place.suffix.lower())
    if write is not None:
        with whole_file(place) as beside:
            write(beside, puppet.canvas, sprites_at_rest(puppet))
        return
    if place.suffix:
        raise InputError(f"--template {place}: expected a folder or a name that ends with .psd or .ora")
    write_cutout(cutout_of(puppet), place)
    with whole_file(place / FLAT) as beside:
        Image.fromarray(merged(puppet.canvas, sprites_at_rest(puppet))).save(beside)


def cutout_of(puppet: Puppet) -> CutOut:
    """Turn a built puppet back into parts and hinges."""
    parts = tuple(Part(name, rgba) for name, rgba in canvas_pictures(puppet).items())
    places = np.einsum("jkcd,jkc->jkd", puppet.vertices[puppet.joint_vertices], puppet.joint_weights).mean(1)
    joints = tuple(
        JointSpec((puppet.names[first], puppet.names[second]), (float(x), float(y)))
        for (first, second), (x, y) in zip(puppet.joint_layers.tolist(), places.tolist(), strict=True)
    )
    return CutOut(puppet.canvas, parts, joints, puppet.reference)
