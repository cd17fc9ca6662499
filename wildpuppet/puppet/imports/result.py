"""What every import ends in: parts on one canvas with names of their own, hinges, and notes for the person.

Readers collect ``Layer``s back to front; ``assembled`` drops the empty ones, gives each a usable name, cuts them to the
canvas and adds the hinges that the file did not hold.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.hinges import completed
from wildpuppet.puppet.imports.limits import Rgba, require_canvas
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import CutOut, JointSpec, Part

_LEAST_ALPHA = PuppetSettings().least_alpha
"""Fainter layers than a puppet's build takes are left out."""


@dataclass(frozen=True, eq=False)
class Layer:
    """One picture at its place: ``corner`` is the canvas pixel (x, y) of its first pixel; groups from outside in."""

    name: str
    rgba: Rgba
    corner: tuple[int, int] = (0, 0)
    groups: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Imported:
    """A cut-out puppet and what the person should know of how it was read, one sentence each."""

    cutout: CutOut
    notes: tuple[str, ...] = ()


def assembled(
    canvas: tuple[int, int],
    layers: Sequence[Layer],
    notes: Sequence[str],
    where: str,
    *,
    joints: Sequence[JointSpec] = (),
    reference: int | None = None,
) -> Imported:
    """Make a cut-out of layers, back to front; ``joints`` name layers, which must have names of their own then.

    Raises:
        PuppetError: the canvas is too big or no layer shows anything on it.
    """
    require_canvas(canvas, len(layers), where)
    told = list(notes)
    taken: set[str] = set()
    names: dict[str, str] = {}
    parts: list[Part] = []
    groups: list[tuple[str, ...]] = []
    for layer in layers:
        rgba = on_canvas(layer, canvas)
        if int(rgba[..., 3].max()) < _LEAST_ALPHA:
            told.append(f"{layer.name!r} is left out: it shows nothing on the canvas")
            continue
        if np.count_nonzero(rgba[..., 3]) < np.count_nonzero(layer.rgba[..., 3]):
            told.append(f"{layer.name!r} reaches beyond the canvas; what lies outside is cut off")
        name = own_name(layer.name, taken)
        if name != layer.name:
            told.append(f"{layer.name!r} is called {name!r}")
        names[layer.name] = name
        parts.append(Part(name, rgba))
        groups.append(layer.groups)
    if not parts:
        raise PuppetError(f"{where}: no layer shows anything; expected at least one visible part with alpha")
    given = tuple(
        JointSpec((names[joint.parts[0]], names[joint.parts[1]]), joint.at)
        for joint in joints
        if set(joint.parts) <= set(names)
    )
    hinges, words = completed(parts, given, groups)
    return Imported(CutOut(canvas, tuple(parts), hinges, reference), (*told, *words))


def without_backdrop(layers: Sequence[Layer], canvas: tuple[int, int], notes: list[str]) -> list[Layer]:
    """Leave out the backmost layers that cover the whole canvas, as long as others are left: paper, not parts."""
    kept = list(layers)
    while len(kept) > 1 and bool((on_canvas(kept[0], canvas)[..., 3] == 255).all()):
        notes.append(f"{kept[0].name!r} covers the whole canvas: taken for the background and left out")
        kept.pop(0)
    return kept


def merged(layers: Sequence[Layer]) -> list[Layer]:
    """Paint neighbours in the order that share their innermost group into one layer with the group's name."""
    found: list[Layer] = []
    last: tuple[str, ...] = ()
    for layer in layers:
        if layer.groups and layer.groups == last:
            found[-1] = over(found[-1], layer)
        else:
            named = replace(layer, name=layer.groups[-1], groups=layer.groups[:-1]) if layer.groups else layer
            found.append(named)
        last = layer.groups
    return found


def over(back: Layer, front: Layer) -> Layer:
    """Paint a layer over another one (straight alpha); the name and groups are the one's behind."""
    corners = np.array([back.corner, front.corner])
    ends = corners + [picture.rgba.shape[1::-1] for picture in (back, front)]
    low, high = corners.min(axis=0), ends.max(axis=0)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    below, above = (
        on_canvas(replace(layer, corner=(int(x), int(y))), size).astype(np.float64) / 255.0
        for layer, (x, y) in zip((back, front), corners - low, strict=True)
    )
    share = above[..., 3:] + below[..., 3:] * (1.0 - above[..., 3:])
    mixed = above[..., :3] * above[..., 3:] + below[..., :3] * below[..., 3:] * (1.0 - above[..., 3:])
    colour = mixed / np.maximum(share, 1e-9)
    rgba = np.rint(255.0 * np.concatenate([colour, share], axis=2)).astype(np.uint8)
    return replace(back, rgba=rgba, corner=(int(low[0]), int(low[1])))


def on_canvas(layer: Layer, canvas: tuple[int, int]) -> Rgba:
    """Put a layer's picture on an empty canvas; what lies outside is cut off."""
    height, width = layer.rgba.shape[:2]
    picture = np.zeros((canvas[1], canvas[0], 4), np.uint8)
    x, y = layer.corner
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + width, canvas[0]), min(y + height, canvas[1])
    if right > left and bottom > top:
        picture[top:bottom, left:right] = layer.rgba[top - y : bottom - y, left - x : right - x]
    return picture


def own_name(name: str, taken: set[str]) -> str:
    """Clean a name (control characters, length) and number it where it is taken."""
    plain = " ".join("".join(letter if letter.isprintable() else " " for letter in name).split())[:90] or "part"
    choice, count = plain, 2
    while choice in taken:
        choice, count = f"{plain} {count}", count + 1
    taken.add(choice)
    return choice
