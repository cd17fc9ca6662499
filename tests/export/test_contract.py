"""What every format promises: any animation, a full manifest, rising progress, the same files twice."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.export.moving import FIRST, moving
from wildpuppet.errors import StoreError
from wildpuppet.export.export import export
from wildpuppet.export.formats import FORMATS
from wildpuppet.export.timing import timing_of

EXACT_PIXELS = 0.01
"""What the table calls exact."""
every_format = pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.name)


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def renamed(animation, *names):
    return replace(animation, puppet=replace(animation.puppet, names=names))


def without_joints(animation):
    none = np.zeros((0, 2, 3))
    bare = replace(
        animation.puppet, joint_layers=np.zeros((0, 2), int), joint_vertices=none.astype(int), joint_weights=none
    )
    return replace(animation, puppet=bare)


def unusual():
    """Animations at the edge of what there is, by name."""
    one, three = moving(1).animation, moving(3).animation
    away = three.video_from_crop + np.array([[0, 0, 500.0], [0, 0, 0]])
    return {
        "one frame": replace(renamed(one, "../arm/<b>&\"'", "größe 机 con"), size=(161, 119)),
        "all lost": replace(renamed(three, "Arm", "arm"), state=("lost",) * 3),
        "first lost": replace(three, state=("lost", "fitted", "held"), video_from_crop=away),
        "drawings": without_joints(replace(three, timing=timing_of(3, None), is_ordered=False)),
    }


@every_format
@pytest.mark.parametrize("name", unusual())
def test_any_animation_is_written(tmp_path, each, name):
    animation, told = unusual()[name], []
    folder = export(animation, each, tmp_path / "out", progress=lambda *step: told.append(step))
    said = manifest(folder)
    assert said["files"] or any(words.startswith("no file:") for words in said["left_out"])
    assert said["format"] == each.name
    assert said["frames"] == [FIRST + t for t in range(len(animation))]
    assert all(said[key] for key in ("origin", "axes", "rate", "parts"))
    assert all(isinstance(words, str) for words in said["left_out"])
    assert said["error"] or each.holds == "pictures"
    if said["error"]:
        assert 0 <= said["error"]["percentile_99_9"] <= said["error"]["largest"]
        assert each.holds != "exact" or said["error"]["largest"] < EXACT_PIXELS
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1][0] == told[-1][1] > 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [each.name]


@every_format
def test_the_same_animation_gives_the_same_files(tmp_path, each):
    first, again = (manifest(export(moving(3).animation, each, tmp_path / name))["files"] for name in ("a", "b"))
    assert first == again


@every_format
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path, each):
    resource = pytest.importorskip("resource")
    animation, (soft, hard) = moving(3).animation, resource.getrlimit(resource.RLIMIT_FSIZE)
    each.writer()
    resource.setrlimit(resource.RLIMIT_FSIZE, (300, hard))
    try:
        with pytest.raises(StoreError, match="cannot write") as told:
            export(animation, each, tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(str(told.value).splitlines()) == 1
    assert list((tmp_path / "out").iterdir()) == []
