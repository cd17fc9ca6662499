import json

import numpy as np
import pytest

from tests.export.moving import FIRST, LOST, NUM_FRAMES, moving
from wildpuppet.errors import InputError
from wildpuppet.export.export import export
from wildpuppet.export.formats import Format, format_of
from wildpuppet.export.manifest import digests
from wildpuppet.export.naming import file_names, identifiers


@pytest.fixture(scope="module")
def world():
    return moving()


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def test_the_manifest_says_what_the_files_cannot(tmp_path, world):
    folder = export(world.animation, format_of("png"), tmp_path)
    said = manifest(folder)
    assert said["format"] == "png"
    assert (said["frames"], said["rate"]) == (list(range(FIRST, FIRST + NUM_FRAMES)), "24000/1001")
    assert said["order_back_to_front"] == [
        {"frame": 100, "parts": ["body", "arm"]},
        {"frame": 105, "parts": ["arm", "body"]},
    ]
    assert (said["held_frames"], said["hidden_frames"], said["shots_start_at"]) == ([102], [104], [100, 106])
    assert any("draw order" in words for words in said["left_out"])
    assert said["files"] == digests(folder)
    assert len(said["files"]) == 3 * NUM_FRAMES


def test_a_variable_rate_is_stated(tmp_path):
    pts = np.array([0, 1001, 3003, 4004, 9009, 10010, 11011, 15015])
    said = manifest(export(moving(pts=pts).animation, format_of("png"), tmp_path))
    assert said["is_variable_rate"]
    assert said["pts"] == pts.tolist()
    assert any("variable frame rate" in words for words in said["left_out"])


def test_progress_rises_to_its_end(tmp_path, world):
    told = []
    export(world.animation, format_of("png"), tmp_path, progress=lambda done, total: told.append((done, total)))
    assert told == [(number, 3 * NUM_FRAMES) for number in range(1, 3 * NUM_FRAMES + 1)]


def test_a_failed_export_leaves_the_earlier_one_and_nothing_else(tmp_path, world):
    folder = export(world.animation, format_of("png"), tmp_path)
    before = digests(folder)

    def fail(done, total):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(world.animation, format_of("png"), tmp_path, progress=fail)
    assert [path.name for path in tmp_path.iterdir()] == ["png"]
    assert digests(folder) == before


def test_exports_are_replaced_but_nothing_of_the_users(tmp_path, world):
    folder = export(world.animation, format_of("png"), tmp_path)
    export(world.animation, format_of("webm"), tmp_path)
    export(world.animation, format_of("png"), tmp_path)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes.txt was changed or added"):
        export(world.animation, format_of("png"), tmp_path)
    (tmp_path / "thesis.doc").write_text("mine")
    with pytest.raises(InputError, match=r"holds other files \(thesis.doc\)"):
        export(world.animation, format_of("webm"), tmp_path)
    with pytest.raises(InputError, match="found a file"):
        export(world.animation, format_of("png"), tmp_path / "thesis.doc")


def test_a_missing_extra_is_told_before_anything_is_written(tmp_path, world):
    absent = Format("later", "", "", "exact", "", "png", "later", ("no_such_module",))
    with pytest.raises(InputError, match="needs more packages"):
        export(world.animation, absent, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_animation_gives_the_truth(world):
    frames = list(world.animation)
    for t, frame in enumerate(frames):
        assert np.abs(frame.vertices - world.vertices(t)).max() < 1e-9
        assert frame.seconds * 24000 == 1001 * t
        assert frame.is_visible == (t != LOST)
    assert world.animation.pose.tolist() == [0, 1, 1, 2, 3, 4, 5, 6]
    assert world.animation.first_of_pose.tolist() == [0, 1, 3, 4, 5, 6, 7]


def test_names_for_files_and_scenes():
    names = ("head", "Head", "00-Arm", "größe/../x", "机", "", "con")
    assert identifiers(names) == ("head", "Head_2", "_00_Arm", "groe_x", "part", "part_2", "con")
    assert file_names(names) == ("head", "Head_2", "00-Arm", "groe_.._x", "part", "part_2", "con_")
