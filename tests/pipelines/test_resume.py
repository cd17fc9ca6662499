"""A run that is killed (kill -9) in the middle of a chunk, and two runs at once."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines import fit_frames
from tests.pipelines.drawn import Drawn, drawn_in, final_files

ROOT = Path(__file__).parents[2]

IN_CHUNKS_OF_THREE = """
import os, signal, sys
from dataclasses import replace
from pipelines import fit_frames
from pipelines.cli import main
from wildpuppet import stages
fit_frames.CHUNK = 3
victim, chunk = sys.argv.pop(1), int(sys.argv.pop(1))

def dies_in_the_middle(*inputs):
    global chunk
    *values, machine = inputs
    def progress(done, total):
        if chunk == 0 and 2 * done >= total:
            os.kill(os.getpid(), signal.SIGKILL)
    result = original.run(*values, replace(machine, progress=progress))
    chunk -= 1
    return result

if victim:
    original = getattr(stages, victim)
    setattr(stages, victim, replace(original, run=dies_in_the_middle))
main()
"""

SEARCH = ("--search.enabled=True", "--search.box-pixels=24", "--search.angles=8", "--search.num-best=1")


def start(drawn: Drawn, out: str, store: str, victim: str = "", chunk: int = 0) -> subprocess.Popen[str]:
    words = [sys.executable, "-c", IN_CHUNKS_OF_THREE, victim, str(chunk), *drawn.arguments(out, store), *SEARCH]
    return subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, text=True)


@pytest.fixture(autouse=True)
def in_chunks_of_three(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit_frames, "CHUNK", 3)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    drawn = drawn_in(tmp_path_factory.mktemp("drawn"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit_frames, "CHUNK", 3)
        assert drawn.run(*SEARCH, out="unbroken") == 0
    return drawn


@pytest.mark.parametrize(("victim", "step"), [("SEARCH_PART", "search"), ("FIT_PART", "fit")])
def test_killed_in_a_chunk_and_run_again_gives_the_same_bytes(
    drawn: Drawn, victim: str, step: str, capsys: pytest.CaptureFixture[str]
) -> None:
    store = f"store of {step}"
    killed = start(drawn, step, store, victim, 1)
    killed.communicate(timeout=300)
    assert killed.returncode == -signal.SIGKILL
    assert not (drawn.folder / step).exists()
    kept = records(drawn.folder / store)
    assert f"{step}.part" in kept.values()
    assert drawn.run(*SEARCH, out=step, store=store) == 0
    assert "crop: kept" in capsys.readouterr().err
    assert kept.items() <= records(drawn.folder / store).items()
    assert final_files(drawn.folder / step) == final_files(drawn.folder / "unbroken")


def records(store: Path) -> dict[str, str]:
    """Key -> stage of every result in a store."""
    return {path.parent.name: json.loads(path.read_text())["stage"] for path in store.glob("entries/*/*/record.json")}


def test_two_runs_at_once_on_one_store_and_one_out_do_not_harm_each_other(drawn: Drawn) -> None:
    processes = [start(drawn, "shared", "shared store") for _ in range(2)]
    for process in processes:
        _, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
    assert final_files(drawn.folder / "shared") == final_files(drawn.folder / "unbroken")
    assert not [path for path in (drawn.folder / "shared store").rglob(".writing-*") if path.is_dir()]
