import time
import zipfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wildpuppet import disk
from wildpuppet.errors import StoreError
from wildpuppet.types import (
    Clip,
    Crops,
    CutOut,
    Fit,
    Hypotheses,
    JointSpec,
    Part,
    PointTracks,
    Poses,
    Puppet,
    Track,
)

T, L, V, N = 3, 2, 5, 4
RNG = np.random.default_rng(7)


def floats(*shape: int) -> np.ndarray:
    return RNG.normal(size=shape)


def a_puppet(reference: int | None) -> Puppet:
    return Puppet(
        names=("torso", "hëad"),
        canvas=(64, 48),
        vertices=floats(V, 2),
        triangles=np.array([[0, 1, 2], [2, 3, 4]]),
        layer_of_vertex=np.array([0, 0, 0, 1, 1]),
        uv=floats(V, 2),
        atlas=RNG.integers(0, 255, (8, 8, 4), dtype=np.uint8),
        joint_layers=np.array([[0, 1]]),
        joint_vertices=np.array([[[0, 1, 2], [2, 3, 4]]]),
        joint_weights=floats(1, 2, 3),
        reference=reference,
    )


def a_crops(reference: int | None, ordered: bool) -> Crops:
    images = RNG.integers(0, 255, (T, 18, 22, 4), dtype=np.uint8)
    return Crops(
        frames=np.arange(4, 4 + T),
        size=(22, 18),
        video_from_crop=floats(T, 2, 3),
        images=images,
        box_crop=floats(T, 4),
        drawing=np.array([0, 0, 1]),
        shot=np.zeros(T, np.int64),
        state=("followed", "bridged", "lost"),
        reference=reference,
        ordered=ordered,
    )


def a_cutout() -> CutOut:
    rgba = np.full((6, 8, 4), 200, np.uint8)
    return CutOut((8, 6), (Part("torso", rgba), Part("head", rgba)), (JointSpec(("torso", "head"), (3.5, 2.25)),), 0)


VALUES: dict[str, Any] = {
    "clip": Clip(Path("a.mp4"), "abc", (640, 480), np.array([0, 1, 3]), Fraction(1001, 24000), (0, 2), (1,)),
    "clip without faults": Clip(Path("a.mp4"), "abc", (640, 480), np.array([0, 1, 3]), Fraction(1, 24)),
    "track": Track(np.arange(T), floats(T, 4), ("followed", "lost", "found"), floats(T), np.zeros(T, np.int64)),
    "crops": a_crops(0, True),
    "crops of drawings": a_crops(None, False),
    "puppet": a_puppet(2),
    "puppet of no frame": a_puppet(None),
    "cutout": a_cutout(),
    "poses": Poses(floats(T, L, 2, 3), np.tile(np.arange(L), (T, 1)), floats(T), floats(T)),
    "hypotheses": Hypotheses(floats(T, N, L, 2, 3), np.zeros((T, N, L), int), np.array([[0, 1, 2, np.inf]] * T)),
    "fit": Fit(
        np.arange(T),
        floats(T, V, 2).astype(np.float32),
        np.tile(np.arange(L), (T, 1)),
        floats(T, V).astype(np.float32),
        ("fitted", "held", "lost"),
        {"arap": floats(T), "reconstruction": floats(T)},
    ),
    "fit without losses": Fit(np.arange(0), floats(0, V, 2), np.zeros((0, L), int), floats(0, V), ()),
    "points": PointTracks(np.arange(T), floats(T, N, 2), np.ones((T, N), bool), floats(T, N)),
}


def save_and_load(name: str, folder: Path) -> Any:
    folder.mkdir()
    kind = name.split()[0]
    getattr(disk, f"save_{kind}")(VALUES[name], folder)
    return getattr(disk, f"load_{kind}")(folder)


def assert_same(value: Any, found: Any, where: str) -> None:
    if isinstance(value, np.ndarray):
        assert isinstance(found, np.ndarray), where
        assert found.dtype == value.dtype, where
        np.testing.assert_array_equal(found, value, where)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            if name not in ("path", "images"):
                assert_same(getattr(value, name), getattr(found, name), f"{where}.{name}")
    elif isinstance(value, tuple | list):
        assert type(found) is type(value), where
        assert len(found) == len(value), where
        for index, (one, other) in enumerate(zip(value, found, strict=True)):
            assert_same(one, other, f"{where}[{index}]")
    elif isinstance(value, dict):
        assert list(found) == sorted(value), where
        for key in value:
            assert_same(value[key], found[key], f"{where}.{key}")
    else:
        assert type(found) is type(value), where
        assert found == value, where


@pytest.mark.parametrize("name", VALUES)
def test_round_trip_keeps_every_field_and_type(name: str, tmp_path: Path) -> None:
    assert_same(VALUES[name], save_and_load(name, tmp_path / "value"), name)


@pytest.mark.parametrize("name", VALUES)
def test_written_twice_is_byte_identical(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_and_load(name, tmp_path / "one")
    monkeypatch.setattr(time, "time", lambda: 2_000_000_000.0)
    save_and_load(name, tmp_path / "two")
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert files
    for path in files:
        assert (tmp_path / "one" / path).read_bytes() == (tmp_path / "two" / path).read_bytes(), path


def test_pictures_of_crops_come_back_to_the_bit(tmp_path: Path) -> None:
    found = save_and_load("crops", tmp_path / "value")
    assert len(found.images) == T
    np.testing.assert_array_equal(found.images[0:T], VALUES["crops"].images)
    np.testing.assert_array_equal(found.images[1:2], VALUES["crops"].images[1:2])


def test_crops_without_their_video_say_so_when_read(tmp_path: Path) -> None:
    disk.save_windows(VALUES["crops"], tmp_path)
    found = disk.load_crops(tmp_path)
    assert len(found.images) == T
    with pytest.raises(StoreError, match="run again"):
        _ = found.images[0:1]


def test_arrays_come_back_read_only(tmp_path: Path) -> None:
    fit = save_and_load("fit", tmp_path / "value")
    with pytest.raises(ValueError, match="read-only"):
        fit.vertices_crop[0] = 0.0


def test_nothing_is_pickled(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="objects"):
        disk.write_arrays(tmp_path / "a.npz", "wildpuppet.a/1", {"a": np.array([None, {}])})


def test_order_of_arrays_and_of_memory_does_not_matter(tmp_path: Path) -> None:
    a, b = floats(4, 3), np.arange(3)
    disk.write_arrays(tmp_path / "one.npz", "wildpuppet.a/1", {"a": a, "b": b})
    disk.write_arrays(tmp_path / "two.npz", "wildpuppet.a/1", {"b": b, "a": np.asfortranarray(a)})
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    with np.load(tmp_path / "one.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["a"], a)


@pytest.mark.parametrize("damage", ["truncated", "not a zip", "gone", "another schema"])
def test_damage_is_a_store_error(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "fit.npz"
    disk.save_fit(VALUES["fit"], tmp_path)
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:-40])
    elif damage == "not a zip":
        path.write_bytes(b"hello")
    elif damage == "gone":
        path.unlink()
    else:
        disk.write_arrays(path, "wildpuppet.fit/2", {})
    with pytest.raises(StoreError, match=r"fit\.npz") as caught:
        disk.load_fit(tmp_path)
    assert "\n" not in str(caught.value)


def test_dates_inside_are_fixed(tmp_path: Path) -> None:
    disk.write_arrays(tmp_path / "a.npz", "wildpuppet.a/1", {"a": np.zeros(1)})
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
