"""Keyframe files that people write, and what the choice over time is given of them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.fit.arms import HAND, cutout
from wildpuppet.errors import InputError
from wildpuppet.pose.keyframes import joined, read_keyframe
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import Followed, Hypotheses, Puppet

GOOD = "part,canvas_x,canvas_y,x,y\nfirst,48,70,80.5,60\n"


@pytest.fixture(scope="module")
def puppet() -> Puppet:
    return build(cutout(), PuppetSettings(edge=0.2))


def test_points_are_mixes_of_their_parts_vertices(puppet: Puppet, tmp_path: Path) -> None:
    text = f"x, y, part, canvas_x, canvas_y, note\n10,20,second,{HAND[0]},{HAND[1]},mine\n30,40,body,48,24,\n"
    (tmp_path / "points.csv").write_text(text, encoding="utf-8-sig")
    keyframe = read_keyframe(tmp_path / "points.csv", 7, puppet)
    assert keyframe.frame == 7
    assert keyframe.points_video.tolist() == [[10, 20], [30, 40]]
    assert puppet.layer_of_vertex[keyframe.corners].tolist() == [[2, 2, 2], [0, 0, 0]]
    rest = (puppet.vertices[keyframe.corners] * keyframe.weights[..., None]).sum(1)
    np.testing.assert_allclose(rest, [HAND, (48, 24)], atol=1e-4)


def test_vertices_and_order_are_taken_as_they_are(puppet: Puppet, tmp_path: Path) -> None:
    vertices = puppet.vertices + 3.25
    np.savez(tmp_path / "pose.npz", vertices_video=vertices, order=np.array([2, 0, 1]))
    keyframe = read_keyframe(tmp_path / "pose.npz", 0, puppet)
    np.testing.assert_array_equal(keyframe.vertices_video, vertices)
    assert keyframe.order is not None
    assert keyframe.order.tolist() == [2, 0, 1]


def rows(text: str) -> Callable[[Path, Puppet], Path]:
    def write(folder: Path, puppet: Puppet) -> Path:
        (folder / "points.csv").write_text(text)
        return folder / "points.csv"

    return write


def arrays(**make: Callable[[Puppet], np.ndarray]) -> Callable[[Path, Puppet], Path]:
    def write(folder: Path, puppet: Puppet) -> Path:
        np.savez(folder / "pose.npz", **{name: array(puppet) for name, array in make.items()})
        return folder / "pose.npz"

    return write


def not_a_number(puppet: Puppet) -> np.ndarray:
    vertices = puppet.vertices.copy()
    vertices[5, 1] = np.nan
    return vertices


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (rows(GOOD.replace("first,48", "thrid,48")), ("line 2", "body, first, second", "'thrid'")),
        (rows(GOOD.replace("canvas_y,", "")), ("points.csv", "part,canvas_x,canvas_y,x,y", "no canvas_y")),
        (rows("first,48,70,80.5,60\n"), ("expected a header", "part")),
        (rows(GOOD.replace("80.5", "nan")), ("line 2", "four numbers", "nan")),
        (rows(GOOD.replace(",60", "")), ("line 2", "four numbers")),
        (rows(GOOD.splitlines()[0]), ("expected rows", "found none")),
        (rows(GOOD.replace("48,70", "80,7")), ("line 2", "a point of first", "80,7")),
        (lambda folder, _: folder / "absent.csv", ("absent.csv", "no such file")),
        (lambda folder, _: folder / "absent.npz", ("absent.npz", "no such file")),
        (arrays(vertices=lambda puppet: puppet.vertices), ("vertices_video", "none of that name")),
        (arrays(vertices_video=lambda puppet: puppet.vertices[1:]), ("shape", "as the puppet has")),
        (arrays(vertices_video=lambda puppet: puppet.vertices[None]), ("take one frame",)),
        (arrays(vertices_video=not_a_number), ("NaN",)),
        (arrays(vertices_video=lambda puppet: puppet.vertices, order=lambda _: np.zeros(3)), ("order", "0 to 2")),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_in_one_line(
    make: Callable[[Path, Puppet], Path], words: tuple[str, ...], puppet: Puppet, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as told:
        read_keyframe(make(tmp_path, puppet), 0, puppet)
    assert "\n" not in str(told.value)
    for word in words:
        assert word in str(told.value)


def test_file_that_is_no_npz(puppet: Puppet, tmp_path: Path) -> None:
    (tmp_path / "pose.npz").write_bytes(b"PK\x03\x04 cut short")
    with pytest.raises(InputError, match=r"pose\.npz: expected an npz"):
        read_keyframe(tmp_path / "pose.npz", 0, puppet)


def carried(frames: list[int], fixed: int, value: float) -> Followed:
    number = len(frames)
    maps, order = np.full((number, 1, 2, 3), value), np.zeros((number, 1), int)
    return Followed(np.array(frames), maps, order, np.full(number, value), np.array(frames) == fixed)


def test_a_keyframe_stands_alone_and_what_follows_it_ends_at_the_next() -> None:
    cost = np.array([[1.0, 2.0]] * 8)
    hypotheses = Hypotheses(np.ones((8, 2, 1, 2, 3)), np.zeros((8, 2, 1), int), cost)
    both = joined(hypotheses, [carried([0, 1, 2, 3, 4], 2, 5.0), carried([1, 2, 3, 4, 5], 4, 7.0)])
    known = [sorted(row[np.isfinite(row)].tolist()) for row in both.cost]
    assert known == [[1, 2, 5], [1, 2, 5], [5], [1, 2, 5, 7], [7], [1, 2, 7], [1, 2], [1, 2]]
    assert (both.crop_from_canvas[[2, 4]] == np.array([5.0, 7.0])[:, None, None, None, None]).all()
    first = hypotheses.cost.shape[1]
    np.testing.assert_array_equal(both.crop_from_canvas[6:, :first], hypotheses.crop_from_canvas[6:])
