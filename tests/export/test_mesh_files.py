import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.correspond import scene
from wildpuppet.export.mesh_files import GAP, write_mesh_files
from wildpuppet.geometry.affine import apply

FILE_PIXELS = 1e-3


@pytest.fixture
def world():
    character = scene.puppet()
    maps = scene.motion(3)
    crops, fit = scene.posed(character, maps)
    order = fit.order.copy()
    order[2] = [1, 0]
    return character, maps, crops, replace(fit, order=order, state=("fitted", "lost", "fitted"))


def names_in(path):
    if path.suffix == ".obj":
        return [line[2:] for line in path.read_text().splitlines() if line.startswith("o ")]
    return [node["name"] for node in tree_of(path.read_bytes())["nodes"] if "mesh" in node]


def tree_of(glb):
    magic, version, _, length, chunk = struct.unpack("<4sIII4s", glb[:20])
    assert (magic, version, chunk) == (b"glTF", 2, b"JSON")
    return json.loads(glb[20 : 20 + length])


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_the_file_says_where_the_part_is_and_what_it_looks_like(tmp_path, world, kind):
    character, maps, crops, fit = world
    files = write_mesh_files(tmp_path / "meshes", character, crops, fit, kind)
    assert [file.name for file in files] == [f"frame_000100.{kind}", f"frame_000102.{kind}"]
    again = write_mesh_files(tmp_path / "again", character, crops, fit, kind)
    assert [a.read_bytes() for a in files] == [b.read_bytes() for b in again]
    assert names_in(files[1]) == ["arm", "body"]
    meshes = trimesh.load_scene(files[1], process=False, maintain_order=True).geometry.values()
    found = np.concatenate([np.column_stack([mesh.vertices, mesh.visual.uv]) for mesh in meshes])
    expected = []
    for rank, layer in enumerate((1, 0)):
        mine = character.layer_of_vertex == layer
        places = apply(maps[2, layer], character.vertices[mine])
        u, v = (character.uv[mine] / character.atlas.shape[1::-1]).T
        expected.append(np.column_stack([places[:, 0], -places[:, 1], np.full(len(u), rank * GAP), u, 1 - v]))
    assert np.abs(found - np.concatenate(expected)).max() < FILE_PIXELS
    for mesh in meshes:
        first, second = (mesh.triangles[:, k] - mesh.triangles[:, 0] for k in (1, 2))
        assert (np.cross(first, second)[:, 2] > 0).all()


def test_glb_is_unlit_and_blended(tmp_path, world):
    character, _, crops, fit = world
    tree = tree_of(write_mesh_files(tmp_path, character, crops, fit, "glb")[0].read_bytes())
    assert tree["extensionsUsed"] == ["KHR_materials_unlit"]
    assert [m["alphaMode"] for m in tree["materials"]] == ["BLEND"] * len(tree["materials"])
    assert len(tree["images"]) == 1


def test_obj_files_share_one_texture(tmp_path, world):
    character, _, crops, fit = world
    write_mesh_files(tmp_path, character, crops, fit, "obj")
    assert sorted(f.name for f in tmp_path.iterdir()) == [
        "atlas.png", "frame_000100.obj", "frame_000102.obj", "puppet.mtl",
    ]  # fmt: skip
    text = (tmp_path / "frame_000100.obj").read_text()
    assert "mtllib puppet.mtl" in text
    assert "usemtl puppet" in text
    assert "newmtl puppet" in (tmp_path / "puppet.mtl").read_text()
