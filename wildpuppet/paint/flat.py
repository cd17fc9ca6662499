"""One flat picture that was painted on: the puppet at rest, the atlas, or the frame that the puppet was drawn from.

Which of them it is a copy of is seen from which it differs least. What changed goes to the front-most part there.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int, UInt8

from wildpuppet.errors import InputError
from wildpuppet.export.sprites import merged, over_white, sprites_at_rest
from wildpuppet.paint.texture import Edit, Picture, canvas_pictures, differs, edited
from wildpuppet.types import Puppet

OPAQUE = 128
"""Alpha from which a part counts as what is seen at a pixel."""


def edited_flat(
    path: Path, after: Picture, puppet: Puppet, frame: Callable[[], UInt8[np.ndarray, "H W 3"] | None]
) -> Edit:
    """Find what was painted on a flat picture; raises InputError for a picture of another size."""
    size = after.shape[1::-1]
    flat = merged(puppet.canvas, sprites_at_rest(puppet))
    candidates = {"rest": flat, "white": _opaque(over_white(flat)), "atlas": puppet.atlas}
    if size == puppet.canvas and (drawn_from := frame()) is not None:
        candidates["frame"] = _opaque(drawn_from)
    fitting = {name: picture for name, picture in candidates.items() if picture.shape == after.shape}
    if not fitting:
        sizes = {picture.shape[1::-1] for picture in candidates.values()}
        expected = " or ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise InputError(
            f"--texture {path}: is {size[0]} x {size[1]}; expected the picture of the puppet at rest or its atlas, "
            f"{expected}, unscaled"
        )
    chosen = min(fitting, key=lambda name: int(differs(fitting[name], after).sum()))
    if chosen == "atlas":
        return edited(puppet, canvas_pictures(puppet), canvas_pictures(replace(puppet, atlas=after)))
    return _of_flat(puppet, fitting[chosen], after)


def _opaque(rgb: UInt8[np.ndarray, "H W 3"]) -> Picture:
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])


def _of_flat(puppet: Puppet, before: Picture, after: Picture) -> Edit:
    """Give each changed pixel to the front-most part there; where alpha was taken away, to all parts."""
    pictures = canvas_pictures(puppet)
    changed = differs(before, after)
    front = _front(puppet, pictures)
    repainted = {}
    for layer, name in enumerate(puppet.names):
        picture = pictures[name].copy()
        mine = changed & (front == layer)
        picture[mine, :3] = after[mine, :3]
        erased = changed & (after[..., 3] < before[..., 3])
        picture[erased, 3] = np.minimum(picture[erased, 3], after[erased, 3])
        repainted[name] = picture
    edit = edited(puppet, pictures, repainted)
    beside = int((changed & (front < 0) & (after[..., 3] > OPAQUE)).sum())
    notes = (f"{beside} painted pixels lie on no part and are left out",) if beside else ()
    return replace(edit, notes=(*notes, *edit.notes))


def _front(puppet: Puppet, pictures: dict[str, Picture]) -> Int[np.ndarray, "H W"]:
    """Number the part that is seen at each pixel at rest, faint ones only where nothing else is; -1: none."""
    front = np.full((puppet.canvas[1], puppet.canvas[0]), -1)
    for least in (1, OPAQUE):
        for layer, name in enumerate(puppet.names):
            covers: Bool[np.ndarray, "H W"] = pictures[name][..., 3] >= least
            front[covers] = layer
    return front
