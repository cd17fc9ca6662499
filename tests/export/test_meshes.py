from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.correspond import scene
from wildpuppet.errors import StoreError
from wildpuppet.export.meshes import write_meshes
from wildpuppet.geometry.affine import apply

FLOAT32_PIXELS = 1e-4


def test_written_twice_the_bytes_are_the_same_and_hold_the_motion(tmp_path):
    character = scene.puppet()
    maps = scene.motion(5)
    crops, fit = scene.posed(character, maps)
    clip = scene.clip(tmp_path / "clip.mp4")
    for name in ("one", "two"):
        write_meshes(tmp_path / name / "meshes.npz", character, crops, fit, clip)
    first, second = tmp_path / "one", tmp_path / "two"
    assert sorted(file.name for file in first.iterdir()) == ["atlas.png", "meshes.npz"]
    for file in first.iterdir():
        assert file.read_bytes() == (second / file.name).read_bytes()
    with np.load(first / "meshes.npz") as stored:
        arm = character.layer_of_vertex == 1
        expected = apply(maps[3, 1], character.vertices[arm])
        assert np.abs(stored["vertices_video"][3, arm] - expected).max() < FLOAT32_PIXELS
        assert stored["names"].tolist() == ["body", "arm"]
        assert stored["pts"].tolist() == [512 * frame for frame in range(100, 105)]
        assert stored["time_base"].tolist() == [1, 12288]
        assert stored["uv"].min() >= 0
        assert stored["uv"].max() <= 1
        assert np.allclose(stored["uv"] * stored["atlas_size"], character.uv)
    assert (np.asarray(Image.open(first / "atlas.png")) == character.atlas).all()


def test_drawings_have_no_times_and_a_refusing_disk_says_so(tmp_path):
    character = scene.puppet()
    crops, fit = scene.posed(character, scene.motion(2), first=0)
    write_meshes(tmp_path / "meshes.npz", character, replace(crops, ordered=False), fit)
    with np.load(tmp_path / "meshes.npz") as stored:
        assert "pts" not in stored.files
    with pytest.raises(StoreError):
        write_meshes(tmp_path / "meshes.npz" / "meshes.npz", character, crops, fit)
