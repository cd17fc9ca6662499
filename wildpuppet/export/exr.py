"""OpenEXR bundle for compositors: ST maps, motion vectors, Cryptomatte and named mattes, three files per frame.

- ``st/st.NNNNN.exr``: where in atlas.png each pixel's colour comes from. R, G: what is seen, A its opacity; PART.U,
  PART.V, PART.A: each part whole, not cut by what covers it. U grows to the right and V **upwards**, 0..1 over the
  atlas, at pixel centres: u = x / width. 32-bit floats, because 16 bits are wrong by half a texel.
- ``motion/motion.NNNNN.exr``: forward.u, forward.v to the next frame and backward.u, backward.v to the one before, in
  pixels, v upwards, for the surface that is seen; 0 where nothing is and across cuts and lost frames. ``confidence``
  is how sure that surface is, 0..1.
- ``mattes/mattes.NNNNN.exr``: Cryptomatte, and the same coverage as a channel for each part.

Read by Nuke, Fusion, Blender, After Effects, Natron.
"""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from PIL import Image

from wildpuppet.errors import StoreError
from wildpuppet.export import cryptomatte
from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.fields import PartFields, Surveyor, foremost, where_foremost
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.naming import identifiers
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress

KINDS = ("st", "motion", "mattes")
DIGITS = 5
TAKEN = ("R", "G", "A", "forward", "backward", "confidence")
"""Names of channels that no part may have."""
Channels = dict[str, np.ndarray]


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write FOLDER/st, FOLDER/motion, FOLDER/mattes and atlas.png."""
    first, surveyor = options.first_of(int(animation.frames[0])), Surveyor(animation)
    Image.fromarray(animation.puppet.atlas).save(folder / "atlas.png")
    for kind in KINDS:
        (folder / kind).mkdir()
    names = identifiers(animation.puppet.names, taken=(*TAKEN, cryptomatte.NAME))
    ids = {layer: cryptomatte.id_of(name) for layer, name in enumerate(animation.puppet.names)}
    for frame in animation:
        parts = surveyor.parts(frame)
        of_kind = {
            "st": st_channels(animation, parts, names),
            "motion": motion_channels(animation, frame, parts),
            "mattes": cryptomatte.channels(parts, ids, animation.size) | matte_channels(animation, parts, names),
        }
        for kind, channels in of_kind.items():
            more = cryptomatte.metadata(animation.puppet.names) if kind == "mattes" else {}
            path = folder / kind / f"{kind}.{first + frame.t:0{DIGITS}d}.exr"
            write_exr(path, channels, animation.timing.rate, more)
        progress(frame.t + 1, len(animation))
    axes = "x right, y down; texture and motion v up"
    return Manifest("top left corner of the picture", axes, first, left_out=_left_out(animation))


def write_exr(path: Path, channels: Channels, rate: Fraction, more: dict[str, str]) -> None:
    """Write one picture, losslessly packed."""
    import OpenEXR

    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "framesPerSecond": rate,
        **more,
    }
    with OpenEXR.File(header, {name: np.ascontiguousarray(values) for name, values in channels.items()}) as file:
        try:
            file.write(str(path))
        except RuntimeError as error:  # all that OpenEXR raises, a full disk included
            words = str(error).partition('". ')[2] or str(error)
            raise StoreError(f"--to exr: cannot write ({words}); free some space, or choose another --out") from None


def st_channels(animation: Animation, parts: list[PartFields], names: tuple[str, ...]) -> Channels:
    """Give where in the atlas each pixel comes from, seen and part by part."""
    best = foremost(parts, animation.size)
    seen, alpha = _plane(animation, 2), _plane(animation, 1)
    channels = {f"{name}.{side}": _plane(animation, 1)[..., 0] for name in names for side in "UVA"}
    atlas = np.array(animation.puppet.atlas.shape[1::-1], np.float64)
    unit = animation.puppet.uv / atlas * (1, -1) + (0, 1)
    for part, is_best in where_foremost(parts, best):
        st = part.mixed(unit, animation.puppet.triangles).astype(np.float32)
        seen[part.window][is_best] = st[is_best]
        alpha[part.window][..., 0] += part.seen
        for side, values in zip("UVA", (st[..., 0], st[..., 1], part.alpha), strict=True):
            channels[f"{names[part.layer]}.{side}"][part.window] = values
    return {"R": seen[..., 0], "G": seen[..., 1], "A": np.clip(alpha[..., 0], 0, 1), **channels}


def motion_channels(animation: Animation, frame: Frame, parts: list[PartFields]) -> Channels:
    """Give how far the seen surface goes to the next frame and to the one before, and how sure it is."""
    best = foremost(parts, animation.size)
    channels: Channels = {}
    for name, step in (("forward", 1), ("backward", -1)):
        motion = _plane(animation, 2)
        moved = _moved(animation, frame, step)
        if moved is not None:
            for part, is_best in where_foremost(parts, best):
                vectors = part.mixed(moved * (1, -1), animation.puppet.triangles)
                motion[part.window][is_best] = vectors[is_best].astype(np.float32)
        channels |= {f"{name}.u": motion[..., 0], f"{name}.v": motion[..., 1]}
    sure = _plane(animation, 1)
    for part, is_best in where_foremost(parts, best):
        values = part.mixed(animation.confidence[frame.t, :, None].astype(np.float64), animation.puppet.triangles)
        sure[part.window][is_best] = values[is_best].astype(np.float32)
    return {**channels, "confidence": sure[..., 0]}


def matte_channels(animation: Animation, parts: list[PartFields], names: tuple[str, ...]) -> Channels:
    """Give how much of each part is seen, a channel per part."""
    channels = {f"{name}.A": _plane(animation, 1)[..., 0] for name in names}
    for part in parts:
        channels[f"{names[part.layer]}.A"][part.window] = part.seen
    return channels


def _moved(animation: Animation, frame: Frame, step: int) -> Float[np.ndarray, "V 2"] | None:
    """Give how far each vertex goes in one step; None where there is no such frame to go to."""
    t = frame.t + step
    if not 0 <= t < len(animation):
        return None
    other = animation[t]
    if not other.is_visible or other.shot != frame.shot or not animation.is_ordered:
        return None
    return np.asarray(other.vertices - frame.vertices)


def _plane(animation: Animation, depth: int) -> Float32[np.ndarray, "H W c"]:
    width, height = animation.size
    return np.zeros((height, width, depth), np.float32)


def _left_out(animation: Animation) -> tuple[str, ...]:
    words = [
        "meshes and joints: the files are pictures",
        "motion to and from lost frames and across cuts, which is 0",
        f"a pixel's parts beyond the {2 * cryptomatte.LAYERS} that cover it most (Cryptomatte alone)",
    ]
    if animation.timing.is_variable:
        words.append("the variable frame rate: picture i is shown at pts[i] * time_base seconds")
    return tuple(words)
