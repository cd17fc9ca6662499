from pathlib import Path

import msgspec
import numpy as np
import pytest

from pipelines.cli import run_command
from pipelines.presets import CONFIGS, check_names, merged, preset_names, read_preset
from tests.pipelines.drawn import REFERENCE, drawn_in
from wildpuppet.api import open_run
from wildpuppet.errors import SettingsError
from wildpuppet.settings import Settings


def test_presets_that_come_along_are_found_and_say_when_to_use_them() -> None:
    assert {"best", "fast", "paper"} <= set(preset_names())
    for name in preset_names():
        assert (CONFIGS / f"{name}.toml").read_text().startswith(f"# {name}: ")
        assert read_preset(name) != Settings()


LIGHT = (
    "--crop.box-pixels=64", "--search.box-pixels=24", "--search.angles=8", "--search.num-best=1",
    "--search.hinge-drawings=0", "--fit.steps=3",
)  # fmt: skip
SHORT = {
    "best": (
        "--crop.box-pixels=64",
        "--search.box-pixels=24",
        "--search.num-best=1",
        "--fit.steps=3",
        "--distil.iterations=2",
    ),
    "fast": ("--crop.box-pixels=64", "--search.box-pixels=24", "--search.num-best=1", "--fit.steps=3"),
    "paper": ("--crop.box-pixels=64", "--puppet.edge=0.25", "--train.iterations=2", "--train.encoder-pixels=16"),
}
"""What makes a run with a preset short; the rest is the preset's own."""


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_runs(name: str, tmp_path: Path) -> None:
    drawn = drawn_in(tmp_path)
    words = ["run", str(drawn.video), "--bbox", drawn.box, "--at", str(REFERENCE), "--puppet", str(drawn.puppet)]
    words += ["--end", str(REFERENCE + 2), "--out", str(tmp_path / "out"), "--store", str(tmp_path / "store")]
    assert run_command([*words, "--config", name, *SHORT[name]]) == 0
    assert (tmp_path / "out" / "sheet.png").is_file()
    assert np.isfinite(open_run(tmp_path / "out").fit.vertices_crop).all()


def test_no_preset_is_all_defaults() -> None:
    assert read_preset("") == Settings()


def test_preset_from_a_file_fills_the_rest_with_defaults(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[fit]\nsteps = 5\n")
    tree = msgspec.to_builtins(Settings())
    tree["fit"]["steps"] = 5
    assert msgspec.to_builtins(read_preset(str(path))) == tree


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[fit]\nstep = 5\n", r"unknown setting fit\.step; did you mean steps\?"),
        ("[fti]\nsteps = 5\n", r"unknown setting fti.*did you mean fit\?"),
        ("steps = 5\n", "unknown setting steps"),
        ("[fit]\narea = -1.0\n", r"fit\.area"),
        ("[fit]\nsteps = 'many'\n", r"fit\.steps"),
        ("[fit\n", "not valid TOML"),
    ],
)
def test_mistakes_in_a_preset_are_one_line(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=message) as caught:
        read_preset(str(path))
    assert "\n" not in str(caught.value)


def test_unknown_preset_names_the_known_ones() -> None:
    with pytest.raises(SettingsError, match=r"fast, paper or a \.toml file.*did you mean paper"):
        read_preset("papr")


def test_changes_are_laid_over_settings_and_checked() -> None:
    assert merged(Settings(), {"fit": {"steps": 9}}).fit.steps == 9
    with pytest.raises(SettingsError, match="did you mean steps"):
        merged(Settings(), {"fit": {"stepz": 9}})
    check_names({"fit": {"steps": 1}}, "here")
