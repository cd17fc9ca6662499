"""THE TABLE OF FORMATS. A format is one file in this folder and one line here.

The file has one public function ``write(animation, folder, options, progress) -> Manifest``:

- ``animation`` (export/animation.py) is read a frame at a time; pictures come from ``export/draw.py``, one at a time.
- ``folder`` is empty and temporary: put every file into it under its final name. It is renamed to OUT/FORMAT when the
  writer has returned and the manifest is written, so nothing half written ever looks finished.
- ``options`` (export/options.py) are a person's choices; ``progress(done, total)`` is called with ``done`` rising.
- The ``Manifest`` (export/manifest.py) says origin, axes, units, first frame, what the format cannot hold of this
  very animation, and the position error where the writer reads its files back. Times, order, shots, hidden and held
  frames and digests are added for it.

Import what only the format needs inside ``write``. What a person can mend raises a WildPuppetError of one line.
A new line here needs a round trip by a real client in tests/export/, and ``python -m tests.export.test_formats``
writes docs/formats.md anew.
"""

import difflib
import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from wildpuppet.errors import InputError, SettingsError
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest
from wildpuppet.export.options import Options
from wildpuppet.machine import Progress

Write = Callable[[Animation, Path, Options, Progress], Manifest]

NOT_VERIFIED = "not run here"
"""What stands for the client of a format whose program cannot be run in our tests."""


@dataclass(frozen=True)
class Format:
    """One line of the table.

    ``holds``: "exact" when vertex positions come back from a client to 0.01 px, "approximate" when they do not,
    "pictures" where pixels are what it is. ``extra`` is the optional dependency to install ("": none) and ``needs``
    the modules by which its absence is noticed. ``client``: what read the files back in our tests.
    """

    name: str
    what: str
    opens_in: str
    holds: Literal["exact", "approximate", "pictures"]
    client: str
    module: str
    extra: str = ""
    needs: tuple[str, ...] = ()

    def writer(self) -> Write:
        """Import the writer; raises InputError where its extra is not installed."""
        if any(importlib.util.find_spec(module) is None for module in self.needs):
            raise InputError(f"--to {self.name}: needs more packages; install them with pip install '{self.install}'")
        return cast("Write", importlib.import_module(f"wildpuppet.export.{self.module}").write)

    @property
    def install(self) -> str:
        """What to give to pip."""
        return f"wildpuppet[{self.extra}]" if self.extra else "wildpuppet"


FORMATS: tuple[Format, ...] = (
    Format(
        "png", "RGBA picture sequences: one per part, one of all", "every editor and compositor", "pictures",
        "Pillow, OpenCV", "png",
    ),
    Format(
        "prores", "ProRes 4444 .mov with alpha: one per part, one of all",
        "After Effects, Premiere, Resolve, Final Cut, Kdenlive, Blender", "pictures", "FFmpeg (PyAV)", "prores",
    ),
    Format(
        "webm", "VP9 .webm with alpha: one per part, one of all", "browsers, OBS, Blender", "pictures",
        "FFmpeg's libvpx (PyAV); Chromium", "webm",
    ),
    Format(
        "usd", "OpenUSD .usdc: a moving mesh per part, joints, a camera", "Blender, Houdini, Maya, Unreal, Fusion",
        "exact", "usd-core and its validators; Blender 5.0", "usd", "usd", ("pxr",),
    ),
    Format(
        "usdz", "the same in one .usdz file", "Quick Look, Blender, Houdini, Maya, Unreal", "exact",
        "usd-core and its validators; Blender 5.0", "usdz", "usd", ("pxr",),
    ),
    Format(
        "glb", "glTF 2.0: a mesh per part, a morph target per drawing", "three.js and browsers, game engines, Blender",
        "exact", "pygltflib; Khronos's validator; three.js in node and Chromium; Blender 5.0", "glb",
    ),
    Format(
        "exr", "OpenEXR: ST maps, motion vectors, Cryptomatte, mattes", "Nuke, Fusion, Blender, After Effects, Natron",
        "pictures", "OpenEXR, OpenCV; OpenImageIO; Blender 5.0", "exr", "exr", ("OpenEXR",),
    ),
    Format(
        "psd", "one layered picture: a layer per part", "Photoshop, Krita, Clip Studio, Affinity", "pictures",
        "psd-tools, Pillow; Krita", "psd",
    ),
    Format(
        "ora", "one layered picture: a layer per part", "Krita, GIMP, MyPaint", "pictures",
        "Pillow, after the OpenRaster specification; Krita", "ora",
    ),
    Format(
        "tapvid", "TAP-Vid point tracks (.npz): a grid on the puppet, hidden or not, how sure",
        "TAPIR, CoTracker, numpy", "exact", "numpy", "tapvid",
    ),
    Format(
        "coco", "COCO annotations: a mask per part, hinges as keypoints", "pycocotools, CVAT, FiftyOne, Detectron2",
        "pictures", "pycocotools", "coco",
    ),
    Format("flo", "Middlebury optical flow to the next frame", "flow tools, OpenCV", "exact", "OpenCV", "flo"),
    Format(
        "dragonbones", "DragonBones 5.5: a bone per part, meshes with deform keys",
        "DragonBones, LoongBones, Cocos, Pixi, Egret", "exact", "DragonBones runtime (node), PixiJS (Chromium)",
        "dragonbones",
    ),
    Format(
        "spine", "Spine 4.2 JSON: a bone per part, meshes with deform keys", "Spine, engines with its runtime",
        "exact", "an evaluator of our tests, after the published format", "spine",
    ),
    Format(
        "godot", "Godot 4 scene: polygons with an animation player", "Godot 4", "exact",
        "godot_parser, with Godot's tracks imitated; Godot 4.6 (Chromium)", "godot",
    ),
    Format(
        "mdd", "MDD point cache with an OBJ", "Blender, LightWave, Modo, Houdini, older Maya and Max", "exact",
        "Blender 5.0, trimesh", "mdd",
    ),
    Format(
        "pc2", "PC2 point cache with an OBJ", "Blender, 3ds Max, older Maya", "exact",
        "Blender 5.0, trimesh", "pc2",
    ),
    Format(
        "aftereffects", "After Effects script: parts as layers, outlines as masks, hinges as nulls", "After Effects",
        "exact", f"{NOT_VERIFIED}; ES3 parsers, and node with After Effects' objects imitated", "aftereffects",
    ),
    Format(
        "nuke", "Nuke script: hinges as tracks, a corner pin per part, STMap set-up", "Nuke", "approximate",
        f"{NOT_VERIFIED}; Tcl, with Nuke's nodes imitated", "nuke",
    ),
    Format(
        "mlt", "MLT: the drawn edge of each part as a rotoscoping spline", "Shotcut, Kdenlive, melt", "exact",
        "an XML parser, with MLT's splines imitated; melt 7.12", "mlt",
    ),
    Format(
        "ebsynth", "EbSynth guides: place on the resting puppet, and mask", "EbSynth", "pictures",
        f"{NOT_VERIFIED}; Pillow", "ebsynth",
    ),
    Format(
        "otio", "OpenTimelineIO: a clip per shot", "Resolve, Premiere and others through OTIO", "pictures",
        "OpenTimelineIO", "otio",
    ),
)  # fmt: skip


def format_of(name: str) -> Format:
    """Find a format by its name; raises SettingsError for an unknown one."""
    named = {each.name: each for each in FORMATS}
    if name in named:
        return named[name]
    near = difflib.get_close_matches(name, named, 1)
    hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(named)}"
    raise SettingsError(f"--to: unknown format {name or 'of no name'}; {hint}")


def formats_of(names: str) -> tuple[Format, ...]:
    """Find the formats of a list separated by commas, each once; raises SettingsError for unknown ones."""
    return tuple(dict.fromkeys(format_of(name.strip()) for name in names.split(",")))


HEADINGS = ("format", "what", "opens in", "positions", "read back by", "extra to install")


def rows() -> list[tuple[str, ...]]:
    """Give the table's cells, a row per format."""
    return [(each.name, each.what, each.opens_in, each.holds, each.client, each.extra or "none") for each in FORMATS]


def markdown() -> str:
    """Write the table as docs/formats.md shows it."""
    lines = ["| " + " | ".join(row) + " |" for row in (HEADINGS, tuple("---" for _ in HEADINGS), *rows())]
    return "\n".join(lines) + "\n"
