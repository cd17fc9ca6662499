import json
import zipfile
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image

pxr = pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdShade, UsdValidation  # noqa: E402

from tests.correspond import scene  # noqa: E402
from tests.export.moving import BEHIND, FILM, FIRST, HELD, LOST, NUM_FRAMES, SHOT, moving  # noqa: E402
from wildpuppet.export.export import export  # noqa: E402
from wildpuppet.export.formats import format_of  # noqa: E402
from wildpuppet.export.options import Options  # noqa: E402

PIXELS = 1e-3
"""float32 of a hundredth of a pixel's coordinate."""
UNITS = 0.01


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def folder(world, tmp_path_factory):
    return export(world.animation, format_of("usd"), tmp_path_factory.mktemp("usd"))


def opened(folder):
    return Usd.Stage.Open(str(next(folder.glob("puppet.usd*"))))


def points(stage, part, code):
    return np.array(UsdGeom.Mesh.Get(stage, f"/Puppet/{part}").GetPointsAttr().Get(code))


@pytest.mark.parametrize("kind", ["usd", "usdz"])
def test_validators_find_nothing(tmp_path, world, kind):
    stage = opened(export(world.animation, format_of(kind), tmp_path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) >= 20
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in found] == []


def test_every_vertex_is_where_it_was(world, folder):
    stage, layers = opened(folder), world.puppet.layer_of_vertex
    for t in range(NUM_FRAMES):
        truth = world.vertices(t)
        for layer, part in enumerate(world.puppet.names):
            found = points(stage, part, FIRST + t)
            if t == LOST:
                assert not np.ptp(found, 0).any()  # shrunk to a point
                continue
            assert np.abs(found[:, :2] / (UNITS, -UNITS) - truth[layers == layer]).max() < PIXELS
            rank = list(world.animation.order[t]).index(layer)
            assert np.allclose(found[:, 2], rank * UNITS)
    before, behind = (points(stage, "arm", FIRST + t)[0, 2] for t in (LOST - 1, BEHIND))
    assert before == pytest.approx(UNITS)
    assert behind == 0
    error = json.loads((folder / "manifest.json").read_text())["error"]
    assert 0 < error["largest"] < PIXELS


def test_faces_and_texture_match_the_atlas(world, folder):
    stage = opened(folder)
    height, width = world.puppet.atlas.shape[:2]
    for layer, part in enumerate(world.puppet.names):
        mesh = UsdGeom.Mesh.Get(stage, f"/Puppet/{part}")
        mine = world.puppet.layer_of_vertex == layer
        st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
        assert np.allclose(
            np.column_stack([st[:, 0] * width, (1 - st[:, 1]) * height]), world.puppet.uv[mine], atol=1e-4
        )
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        a, b, c = (points(stage, part, FIRST)[faces[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()
        assert len(faces) == (world.puppet.layer_of_triangle == layer).sum()
        low, high = np.array(mesh.GetExtentAttr().Get(FIRST + 1))
        assert (low, high) == (pytest.approx(points(stage, part, FIRST + 1).min(0)), pytest.approx(high))
        material = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]
        surface = material.ComputeSurfaceSource()[0]
        for socket in ("emissiveColor", "opacity"):
            texture = surface.GetInput(socket).GetConnectedSources()[0][0].source
            path = UsdShade.Shader(texture.GetPrim()).GetInput("file").Get().resolvedPath
            assert (np.asarray(Image.open(path)) == world.puppet.atlas).all()


def test_times_steps_and_visibility(world, folder):
    stage = opened(folder)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == float(FILM)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (FIRST, FIRST + NUM_FRAMES - 1)
    puppet = UsdGeom.Imageable.Get(stage, "/Puppet")
    seen = [puppet.ComputeVisibility(FIRST + t) for t in range(NUM_FRAMES)]
    assert [t for t, word in enumerate(seen) if word == "invisible"] == [LOST]
    for before in (HELD, SHOT - 1):  # the drawing stays until the next one comes
        shown = points(stage, "arm", FIRST + before + 0.9985)
        next_one = points(stage, "arm", FIRST + before + 1)
        assert np.abs(shown - points(stage, "arm", FIRST + before)).max() < np.abs(shown - next_one).max() / 2


def test_uneven_times_are_exact_codes(tmp_path):
    pts = np.array([0, 1001, 3003, 4004, 9009, 10010, 11011, 15015 + 300])
    world = moving(pts=pts)
    stage = opened(export(world.animation, format_of("usd"), tmp_path, Options(first_frame=1001)))
    codes = [float(1001 + Fraction(int(time), 24000) * FILM) for time in pts]
    assert stage.GetStartTimeCode() == 1001
    assert stage.GetEndTimeCode() == codes[-1]
    mine = world.puppet.layer_of_vertex == 1
    for t in (3, 7):
        assert np.abs(points(stage, "arm", codes[t])[:, :2] / (UNITS, -UNITS) - world.vertices(t)[mine]).max() < PIXELS


def test_the_camera_sees_the_video(world, folder):
    stage = opened(folder)
    camera = UsdGeom.Camera.Get(stage, "/Puppet/Camera").GetCamera(FIRST)
    window = camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix()
    width, height = scene.CANVAS
    for x, y in ((0, 0), (width, height), (37, 80)):
        for rank in (0, 1):
            u, v, _ = window.Transform((x * UNITS, -y * UNITS, rank * UNITS))
            assert ((u + 1) / 2 * width, (1 - v) / 2 * height) == pytest.approx((x, y), abs=0.01)


def test_joints_move_with_their_parts(world, folder):
    stage = opened(folder)
    joint = UsdGeom.Xformable.Get(stage, "/Puppet/Joints/body_to_arm")
    x, y, _ = joint.ComputeLocalToWorldTransform(FIRST + 3).ExtractTranslation()
    vertices = world.vertices(3)
    sides = [(vertices[i] * w[:, None]).sum(0) for i, w in zip(
        world.puppet.joint_vertices[0], world.puppet.joint_weights[0], strict=True
    )]  # fmt: skip
    assert (x / UNITS, -y / UNITS) == pytest.approx(tuple(np.mean(sides, 0)), abs=PIXELS)


def test_the_package_holds_its_texture_uncompressed(tmp_path, world):
    folder = export(world.animation, format_of("usdz"), tmp_path)
    assert sorted(path.name for path in folder.iterdir()) == ["manifest.json", "puppet.usdz"]
    with zipfile.ZipFile(folder / "puppet.usdz") as package:
        assert [(info.filename, info.compress_type) for info in package.infolist()] == [
            ("puppet.usdc", 0),
            ("atlas.png", 0),
        ]


def test_how_sure_each_vertex_is_comes_along(tmp_path, world):
    sure = np.random.default_rng(1).random(world.animation.confidence.shape)
    stage = opened(export(replace(world.animation, confidence=sure), format_of("usd"), tmp_path))
    for layer, name in enumerate(world.puppet.names):
        primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(f"/Puppet/{name}")).GetPrimvar("confidence")
        assert primvar.GetInterpolation() == "vertex"
        for t in (0, 3):
            found = np.array(primvar.Get(FIRST + t))
            assert np.allclose(found, sure[t, world.puppet.layer_of_vertex == layer], atol=1e-6)
