"""Every command line of the README is run or, where it names files that are the reader's own, at least understood."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.cli import command_of, load, parse

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
START, AT, END = 149, 150, 152
"""The main job's range here; the README's commands that follow name frames 150 and 151."""


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def commands(block: str) -> list[list[str]]:
    return [shlex.split(part) for line in block.splitlines() for part in line.split("&&")]


MAIN_JOB, TEST_COMMAND, AFTERWARDS, OTHERS, EXPORTS, PUPPETS = blocks("sh")


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder where the README's main job was done as a user would, on a few of its frames."""
    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "examples" / "bluto", folder / "examples" / "bluto")
    _install, job = commands(MAIN_JOB)
    for flag, frame in (("--start", START), ("--end", END)):
        job[job.index(flag) + 1] = str(frame)
    run_installed(job, folder)
    return folder


def run_installed(words: list[str], folder: Path) -> str:
    program = Path(sys.executable).with_name(words[0])
    done = subprocess.run([program, *words[1:]], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_main_job_leaves_what_the_readme_says(workplace: Path) -> None:
    out = workplace / "out" / "bluto"
    named = {name for row in re.findall(r"^\| (`.*?) \|", README, re.MULTILINE) for name in re.findall("`(.*?)`", row)}
    assert {path.name + "/" * path.is_dir() for path in out.iterdir()} == named - {"meshes/", "puppet/"}
    with np.load(out / "meshes.npz") as meshes:
        described = re.search(r"^\| `meshes.npz` \| (.*) \|$", README, re.MULTILINE)
        assert described is not None
        assert {name.split()[0] for name in re.findall("`(.*?)`", described[1])} <= set(meshes)
        assert meshes["frames"].tolist() == list(range(START, END))
        vertices = meshes["vertices_video"][AT - START]
    x, y, width, height = 285, 125, 275, 318
    assert np.linalg.norm((vertices.min(0) + vertices.max(0)) / 2 - (x + width / 2, y + height / 2)) < 0.1 * height
    with Image.open(out / "sheet.png") as sheet:
        assert min(sheet.size) > 200


def test_commands_on_a_run_work_as_written(workplace: Path) -> None:
    (workplace / "points.csv").write_text("x,y,part\n418,215,head\n430,300\n")
    told = [run_installed(words, workplace) for words in commands(AFTERWARDS)]
    with np.load(workplace / "tracks.npz") as tracks, np.load(workplace / "flow.npz") as flow:
        assert tracks["points"].shape == (END - START, 2, 2)
        assert flow["flow"].shape == (536, 720, 2)
    assert "would run because settings.fit.area" in "".join(told)
    (snippet,) = blocks("python")
    subprocess.run([sys.executable, "-c", snippet], cwd=workplace, check=True)


def test_a_puppet_is_cut_out_as_written(workplace: Path) -> None:
    told = run_installed(commands(PUPPETS)[1], workplace)
    assert "11 parts on 720 x 536" in told
    assert (workplace / "outlined" / "puppet.json").is_file()


def test_exports_leave_what_the_readme_names(workplace: Path) -> None:
    for words in commands(EXPORTS):
        run_installed(words, workplace)
    named = set(re.findall(r"`(files/[^`]*)`", README))
    assert named
    assert all((workplace / path).exists() for path in named)


@pytest.mark.parametrize("words", [*commands(OTHERS), *commands(PUPPETS)], ids=shlex.join)
def test_other_commands_are_understood(words: list[str]) -> None:
    name, rest = command_of(words[1:])
    assert isinstance(parse(load(name), name, rest), load(name).Arguments)


def test_ci_calls_the_readmes_test_command() -> None:
    (line,) = TEST_COMMAND.splitlines()
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert f'TEST_COMMAND="{line}"' in script
    assert 'bash -c "$TEST_COMMAND"' in script


def test_links_lead_to_files() -> None:
    assert all((ROOT / target).is_file() for target in re.findall(r"\]\(([^)#:]+)\)", README))
