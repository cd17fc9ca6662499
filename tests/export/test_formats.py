import importlib
import inspect
from pathlib import Path

import pytest

from wildpuppet.errors import InputError, SettingsError
from wildpuppet.export import formats
from wildpuppet.export.formats import FORMATS, Format, format_of, formats_of

DOCS = Path(__file__).parents[2] / "docs" / "formats.md"
HEAD = """# Formats

What `wildpuppet export RUN --to FORMAT` writes. *positions*: `exact` means that every vertex was read back to 0.01
pixel. *read back by*: what opened the files in the tests; `not run here` means that the program could not be run, and
that the text was read by a parser of its language instead. Blender, Chromium, Godot, OpenImageIO, melt, Krita and
Inkscape are too large for the suite: `tests/clients/` runs them (`tests/clients/install.sh`, then
`python -m pytest -m clients`).

"""
CLIENTS = (
    (
        "Blender (bpy) 5.0.1", "2026-11-22",
        "every vertex of `usd`, `usdz`, `glb`, `mdd`, `pc2` to 0.001 pixel; pictures through the camera; "
        "`exr` by the compositor's Map UV and Cryptomatte",
    ),
    (
        "Chromium 150", "2026-11-22",
        "`webm` in a video element, `glb` by three.js 0.187, `dragonbones` by PixiJS 8.22: pictures, alpha, order",
    ),
    ("Godot 4.6, web build", "2026-11-22", "`godot`: every vertex to 0.002 pixel, order, visibility, pictures"),
    ("OpenImageIO 3.2.2", "2026-11-22", "`exr`: `st_warp` draws every part; channels, rate, Cryptomatte's notes"),
    ("melt 7.12.0", "2026-11-22", "`mlt`: the area of every part in every frame, to the pixel along its edge"),
    (
        "Krita 5.1.5", "2026-11-22",
        "`psd`, `ora`: the merged picture, and names, places and pixels of the layers that it saved anew; "
        "imports of files that it wrote",
    ),
    ("Inkscape 1.2.2", "2026-11-22", "imports of SVG outlines that it wrote"),
)  # fmt: skip
"""Programs, the day of their last run (all of it passed), and what was compared."""


def document() -> str:
    rows = (("client", "last run", "compared"), ("---",) * 3, *CLIENTS)
    table = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    made = "\n\nThis page is made from the table in `wildpuppet/export/formats.py`.\n\n"
    return HEAD + table + made + formats.markdown()


def test_the_document_is_up_to_date():
    assert DOCS.read_text(encoding="utf-8") == document(), "run python -m tests.export.test_formats"


def test_every_format_is_a_file_with_a_writer_of_one_shape():
    names = [each.name for each in FORMATS]
    assert len(set(names)) == len(names)
    for each in FORMATS:
        module = importlib.import_module(f"wildpuppet.export.{each.module}")
        assert list(inspect.signature(module.write).parameters) == ["animation", "folder", "options", "progress"]
        assert module.__doc__
        assert all((each.what, each.opens_in, each.client))


def test_extras_are_declared():
    import tomllib

    project = tomllib.loads((DOCS.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = {each.extra for each in FORMATS if each.extra}
    assert wanted <= set(extras)
    assert {line for extra in wanted for line in extras[extra]} <= set(extras["export"]) <= set(extras["dev"])


def test_unknown_names_and_missing_packages_are_told():
    with pytest.raises(SettingsError, match="unknown format pgn; did you mean png"):
        format_of("pgn")
    with pytest.raises(SettingsError, match="expected one of png, "):
        formats_of("png,,")
    assert [each.name for each in formats_of("webm, png,webm")] == ["webm", "png"]
    absent = Format("later", "", "", "exact", "", "png", "later", ("no_such_module",))
    with pytest.raises(InputError, match=r"--to later: needs more packages.*wildpuppet\[later\]"):
        absent.writer()


if __name__ == "__main__":
    DOCS.write_text(document(), encoding="utf-8")
