import numpy as np
import pytest

from wildpuppet.correspond.points import read_points, read_tracks, write_tracks
from wildpuppet.errors import InputError, StoreError
from wildpuppet.types import PointTracks


@pytest.mark.parametrize("head", ["x,y,part\n", "\ufeffX, Y, part\n\n", ""])
def test_rows_with_and_without_parts(tmp_path, head):
    path = tmp_path / "points.csv"
    path.write_text(head + "1.5,2,arm\n3,4\n5,6,\n")
    points, parts = read_points(path)
    assert points.tolist() == [[1.5, 2], [3, 4], [5, 6]]
    assert parts == ("arm", None, None)


@pytest.mark.parametrize(
    ("rows", "line"), [("x,y\n1,2\n3\n", 3), ("1,2\nx,y\n", 2), ("nan,2\n", 1), ("x,y\n1,2,a,b\n", 2)]
)
def test_a_bad_row_is_named_by_its_line(tmp_path, rows, line):
    path = tmp_path / "points.csv"
    path.write_text(rows)
    with pytest.raises(InputError, match=f"line {line}: expected x,y"):
        read_points(path)


def test_empty_and_missing_files(tmp_path):
    (tmp_path / "empty.csv").write_text("x,y\n")
    for name in ("empty.csv", "missing.csv"):
        with pytest.raises(InputError, match=name):
            read_points(tmp_path / name)


def test_tracks_round_trip_and_leave_nothing_beside(tmp_path):
    rng = np.random.default_rng(0)
    tracks = PointTracks(np.arange(3), rng.random((3, 4, 2)), rng.random((3, 4)) > 0.5, rng.random((3, 4)))
    path = tmp_path / "deep" / "tracks.npz"
    write_tracks(path, tracks)
    again = read_tracks(path)
    assert [again.points_video.dtype, again.visible.dtype, again.confidence.dtype, again.frames.dtype] == [
        np.float32, bool, np.float32, np.int64,
    ]  # fmt: skip
    assert np.allclose(again.points_video, tracks.points_video)
    assert [file.name for file in path.parent.iterdir()] == ["tracks.npz"]
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError):
        write_tracks(tmp_path / "file" / "tracks.npz", tracks)
    with pytest.raises(InputError):
        read_tracks(tmp_path / "file")
