"""DragonBones' pictures: regions of texture atlases (``NAME_tex.json``), turned and trimmed, or single files.

A region may lie in the atlas turned by a quarter, clockwise; ``frameX, frameY, frameWidth, frameHeight`` say of which
larger picture it is the part that was not empty.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.limits import Rgba, inside, number, read_json, read_picture

MOST_REGIONS = 5000
_FOLDERS = ("", "texture", "textures", "library", "images")


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture, upright and whole: ``scale`` is armature units per pixel."""

    rgba: Rgba
    scale: float


class Textures:
    """All pictures that an armature may name, decoded when asked for."""

    def __init__(self, skeleton: Path, embedded: object) -> None:
        self._folder = skeleton.parent
        self._regions: dict[str, tuple[Path, dict[str, Any], float]] = {}
        self._pages: dict[Path, Rgba] = {}
        for path, atlas in _atlases(skeleton, embedded):
            self._add(path, atlas)

    def find(self, name: str, where: str) -> Texture:
        """Give the picture of that name; raises PuppetError where there is none."""
        if name in self._regions:
            path, region, scale = self._regions[name]
            return Texture(_region(self._page(path), region, f"{path}: {name!r}"), scale)
        for folder in _FOLDERS:
            path = inside(self._folder, f"{folder}/{name}.png" if folder else f"{name}.png", where)
            if path.is_file():
                return Texture(read_picture(path, str(path)), 1.0)
        raise PuppetError(f"{where}: its picture {name[:80]!r} is in no atlas (*_tex.json) beside it, nor a PNG there")

    def _add(self, path: Path, atlas: dict[str, Any]) -> None:
        regions = atlas.get("SubTexture")
        if not isinstance(regions, list) or len(regions) > MOST_REGIONS:
            raise PuppetError(f"{path}: expected SubTexture, a list of at most {MOST_REGIONS} regions")
        page = inside(path.parent, atlas.get("imagePath"), f"{path}: imagePath")
        scale = number(atlas.get("scale", 1.0), f"{path}: scale")
        if scale <= 0.0:
            raise PuppetError(f"{path}: scale is {scale}; expected more than 0")
        for region in regions:
            if isinstance(region, dict) and isinstance(region.get("name"), str):
                self._regions.setdefault(region["name"], (page, region, 1.0 / scale))

    def _page(self, path: Path) -> Rgba:
        if path not in self._pages:
            self._pages[path] = read_picture(path, str(path))
        return self._pages[path]


def _atlases(skeleton: Path, embedded: object) -> list[tuple[Path, dict[str, Any]]]:
    """Find the atlas files of a skeleton: those of its name, else all in its folder."""
    if isinstance(embedded, list) and embedded:
        return [(skeleton, atlas) for atlas in embedded if isinstance(atlas, dict)]
    base = skeleton.stem.removesuffix("_ske")
    named = sorted(skeleton.parent.glob("*tex*.json"))
    own = [path for path in named if path.stem.startswith(f"{base}_tex")]
    trees = [(path, read_json(path)) for path in own or named if path != skeleton]
    return [(path, tree) for path, tree in trees if "SubTexture" in tree]


def _region(page: Rgba, region: dict[str, Any], where: str) -> Rgba:
    """Cut a region out of its page, turn it upright and give it back its empty margins."""
    x, y, width, height = (int(number(region.get(key, 0), f"{where} {key}")) for key in ("x", "y", "width", "height"))
    if x < 0 or y < 0 or width < 1 or height < 1 or x + width > page.shape[1] or y + height > page.shape[0]:
        raise PuppetError(
            f"{where}: region {x},{y} {width} x {height} lies outside its page of {page.shape[1]} x {page.shape[0]}"
        )
    cut = page[y : y + height, x : x + width]
    if region.get("rotated") in (True, 1, "1", "true"):
        cut = np.rot90(cut)
    whole = [int(number(region.get(key, -1), f"{where} {key}")) for key in ("frameWidth", "frameHeight")]
    if min(whole) <= 0:
        return np.ascontiguousarray(cut)
    left, top = (-int(number(region.get(key, 0), f"{where} {key}")) for key in ("frameX", "frameY"))
    if left < 0 or top < 0 or left + cut.shape[1] > whole[0] or top + cut.shape[0] > whole[1] or max(whole) > 16384:
        raise PuppetError(f"{where}: its frame {whole[0]} x {whole[1]} does not hold the region")
    picture = np.zeros((whole[1], whole[0], 4), np.uint8)
    picture[top : top + cut.shape[0], left : left + cut.shape[1]] = cut
    return picture
