import subprocess
import sys
from pathlib import Path

import pytest
import tyro

from pipelines.arguments import parse, with_split_box
from pipelines.cli import COMMANDS, load, run_command
from pipelines.run import Arguments, defaults
from wildpuppet.errors import SettingsError

HEAVY = {"torch", "cv2", "numba", "scipy", "av", "skimage", "PIL"}


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["fit", "--help"], ["points", "--help"]])
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    code = (
        "import sys\nfrom pipelines.cli import run_command\n"
        f"try:\n    run_command({words!r})\nexcept SystemExit: pass\n"
        f"sys.stderr.write(' '.join(sorted({HEAVY!r} & set(sys.modules))))"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert "wildpuppet" in done.stdout
    assert done.stderr == ""


def test_import_of_the_package_is_light() -> None:
    code = "import sys, wildpuppet\nprint(sorted({'torch', 'numpy', 'tyro'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_arguments_and_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert hasattr(load(name), "main")
    with pytest.raises(SystemExit) as end:
        run_command([*name.split(), "--help"])
    assert end.value.code == 0
    assert f"usage: wildpuppet {name}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [["--bbox", "-1,2.5,3,4"], ["--bbox=-1,2.5,3,4"], ["--bbox", "-1", "2.5", "3", "4"], ["--bbox", "-1, 2.5,3, 4"]],
)
def test_box_is_one_word_or_four(words: list[str]) -> None:
    argv = with_split_box(["clip.mp4", *words, "--at", "7"])
    arguments = parse(Arguments, argv, "wildpuppet run", defaults(argv))
    assert (arguments.bbox, arguments.at, arguments.video) == ((-1.0, 2.5, 3.0, 4.0), 7, Path("clip.mp4"))


@pytest.mark.parametrize("box", ["1,2,3", "1,2,3,4,5", "1,2,3,x", "a,b"])
def test_box_that_is_not_four_numbers_is_refused(box: str) -> None:
    with pytest.raises(SettingsError, match="expected four numbers"):
        with_split_box(["--bbox", box])


@pytest.mark.parametrize("has_lines", [True, False])
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a", "--fit.stepz", "3"], r"unknown setting --fit\.stepz; did you mean --fit\.steps\?; see wildpuppet"),
        (["--at", "3"], "VIDEO and --bbox X,Y,W,H are needed"),
        (["a", "--fit.steps", "abc"], r"--fit\.steps: expected a whole number, found 'abc'; see"),
        (["a", "--device", "gpu"], "'gpu' for argument '--device'"),
    ],
)
def test_parsers_boxes_become_one_line(
    words: list[str], message: str, has_lines: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(tyro._experimental_options, "utf8_boxes", has_lines)
    box = [] if message.startswith("VIDEO") else ["--bbox", "1", "2", "3", "4"]
    with pytest.raises(SettingsError, match=message) as caught:
        parse(Arguments, [*words, *box], "wildpuppet run", defaults(words))
    assert "\n" not in str(caught.value)
    assert "---" not in str(caught.value)


def test_flags_win_over_the_preset_and_the_preset_over_defaults() -> None:
    argv = ["clip.mp4", "--bbox", "1", "2", "3", "4", "--config", "paper", "--fit.arap", "7", "--crop.matte", "False"]
    arguments = parse(Arguments, argv, "wildpuppet run", defaults(argv))
    assert arguments.settings.fit.method == "network"
    assert not arguments.settings.search.enabled
    assert arguments.settings.fit.arap == 7.0
    assert arguments.settings.crop.matte is False
    assert arguments.settings.fit.seed == 0


def test_ctrl_c_says_that_what_is_finished_is_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def stop(arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(load("prune"), "main", stop)
    assert run_command(["prune", "--store", str(tmp_path)]) == 130
    assert "kept: run again to resume" in capsys.readouterr().err
