"""Every stage on a tiny input against a stored summary: a changed answer with an unchanged version fails.

    python -m tests.test_stage_versions     stores the summaries anew

The settings stand in the stored file too, so that a changed default, which is part of every key, changes nothing here.
"""

import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import msgspec
import pytest
import torch

from tests.stage_inputs import INPUTS, Drawn
from tests.summaries import Summary, differences, summary_of
from wildpuppet.errors import SettingsError
from wildpuppet.machine import Machine
from wildpuppet.settings import Settings, settings_from
from wildpuppet.stages import STAGES, Stage

STORED = Path(__file__).parent / "data" / "stage_summaries.json"
SCHEMA = "wildpuppet.stage_summaries/1"
AGAIN = "then run `python -m tests.test_stage_versions` to store the new summary"

QUICK = {
    "crop": {"box_pixels": 64},
    "puppet": {"edge": 0.25},
    "search": {"box_pixels": 32, "angles": 12, "num_best": 3},
    "fit": {"steps": 6},
    "distil": {"iterations": 2},
    "train": {"iterations": 2, "encoder_pixels": 16, "code": 16},
    "out": {"meshes": "obj"},
}
"""Settings that make the stages quick, where they differ from the defaults."""

TOLERANCE = 0.005
"""Share of an array's spread. Other processors round otherwise, which moves numbers by less than a tenth of this."""
CODEC_TOLERANCE = 0.02
"""The same for pictures that went through OpenCV's resampling or a lossy codec, which round by whole grey levels."""
LOOSE = {"track", "crop", "automatic", "preview"}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    return Drawn(tmp_path_factory.mktemp("drawn"))


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_changed_answer_has_a_changed_version(stage: Stage, drawn: Drawn, tmp_path: Path) -> None:
    stored = json.loads(STORED.read_text())
    known = stored["stages"].get(stage.name)
    assert known is not None, f"{stage.name}: a new stage; {AGAIN.removeprefix('then ')}"
    try:
        settings = settings_from(stored["settings"])
    except SettingsError as error:
        pytest.fail(f"{error}: if answers changed, add 1 to their stages' versions in wildpuppet/stages.py; {AGAIN}")
    changed = differences(known["summary"], answer(stage, drawn, settings, tmp_path), tolerance_of(stage))
    if stage.version != known["version"]:
        pytest.fail(f"{stage.name}: version {known['version']} -> {stage.version}; {AGAIN.removeprefix('then ')}")
    if changed:
        inputs = differences(stored["inputs"], inputs_of(drawn), TOLERANCE)
        also = f" Its inputs changed as well ({', '.join(inputs)}): if nothing else did, leave it." if inputs else ""
        pytest.fail(
            f"{stage.name}: the answer changed ({', '.join(changed)}) but the version is still {stage.version}. "
            f"Add 1 to it in wildpuppet/stages.py; {AGAIN}.{also}"
        )


def test_a_changed_answer_is_seen() -> None:
    known = json.loads(STORED.read_text())["stages"]["fit.part"]["summary"]
    for index in range(6):
        moved = json.loads(json.dumps(known))
        moved["vertices_crop"]["numbers"][index] += 0.02 * known["vertices_crop"]["numbers"][1]
        assert differences(known, moved, TOLERANCE) == ["vertices_crop"]
    assert differences(known, {**known, "state": ["lost"]}, TOLERANCE) == ["state"]


def tolerance_of(stage: Stage) -> float:
    return CODEC_TOLERANCE if stage.name in LOOSE else TOLERANCE


def answer(stage: Stage, drawn: Drawn, settings: Settings, folder: Path) -> Summary:
    """Run a stage, keep its value and read it back, as a run does; summarise it."""
    torch.set_num_threads(1)
    tables = [getattr(settings, name) for name in stage.settings]
    checkpoint = [folder / "checkpoint"] if stage.has_checkpoint else []
    value = stage.run(*INPUTS[stage.name](drawn), *tables, Machine("cpu"), *checkpoint)
    kept = folder / "kept"
    kept.mkdir()
    stage.save(value, kept)
    return summary_of(stage.load(kept))


def inputs_of(drawn: Drawn) -> Summary:
    """Summarise what the stages are given."""
    values = {"frames": drawn.scene.frames, "alpha": drawn.scene.alpha, "maps": drawn.scene.video_from_canvas}
    return summary_of({**values, "cutout": drawn.scene.cutout, "puppet": drawn.puppet, "clip": drawn.clip})


def store_anew() -> None:
    """Write the summaries of all stages."""
    tree: dict[str, Any] = msgspec.to_builtins(Settings())
    for table, values in QUICK.items():
        tree[table] |= values
    with tempfile.TemporaryDirectory() as scratch:
        drawn = Drawn(Path(scratch))
        stages = {}
        for stage in STAGES:
            (folder := Path(scratch) / f"stage {stage.name}").mkdir()
            stages[stage.name] = {
                "version": stage.version,
                "summary": answer(stage, drawn, settings_from(tree), folder),
            }
        stored = {"schema": SCHEMA, "settings": tree, "inputs": inputs_of(drawn), "stages": stages}
    STORED.parent.mkdir(exist_ok=True)
    text = json.dumps(stored, indent=1, sort_keys=True)
    rows = re.sub(r"\[[^][{}]*\]", lambda found: " ".join(found[0].split()), text)  # lists on one line
    STORED.write_text(f"{rows}\n")


if __name__ == "__main__":
    store_anew()
    sys.stdout.write(f"stored {len(STAGES)} summaries in {STORED}\n")
