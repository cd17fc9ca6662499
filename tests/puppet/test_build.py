import cv2
import numpy as np
import pytest

from wildpuppet.errors import PuppetError
from wildpuppet.geometry.topology import boundary_edges, components, smallest_angles
from wildpuppet.puppet.build import build, rest_box
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import CutOut, JointSpec, Part, Puppet

SIZE = (240, 200)
SETTINGS = PuppetSettings(edge=0.1)


def blank() -> np.ndarray:
    picture = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    picture[..., :3] = np.random.default_rng(0).integers(0, 256, 3)
    return picture


def disc(x: float, y: float, radius: float, color: tuple[int, int, int]) -> np.ndarray:
    """Draw a disc with an exact one-pixel ramp; corner origin. Transparent pixels are magenta."""
    across, down = np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5
    alpha = np.clip(radius + 0.5 - np.hypot(across - x, down[:, None] - y), 0.0, 1.0)
    picture = np.full((SIZE[1], SIZE[0], 4), (255, 0, 255, 0), np.uint8)
    picture[alpha > 0, :3] = color
    picture[..., 3] = np.round(255 * alpha)
    return picture


def bar(x0: int, y0: int, x1: int, y1: int, color: tuple[int, int, int]) -> np.ndarray:
    picture = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    picture[y0:y1, x0:x1] = (*color, 255)
    return picture


def two_parts(*joints: JointSpec) -> CutOut:
    body = Part("body", disc(90.0, 100.0, 50.0, (200, 40, 40)))
    arm = Part("arm", bar(120, 90, 220, 110, (40, 40, 200)))
    return CutOut(SIZE, (body, arm), joints, 7)


def sample(atlas: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Sample bilinearly in NumPy; corner origin."""
    corner = np.floor(points - 0.5).astype(int)
    share = points - 0.5 - corner
    values = np.zeros((len(points), atlas.shape[2]))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = (share[:, 0] if dx else 1.0 - share[:, 0]) * (share[:, 1] if dy else 1.0 - share[:, 1])
            x = np.clip(corner[:, 0] + dx, 0, atlas.shape[1] - 1)
            y = np.clip(corner[:, 1] + dy, 0, atlas.shape[0] - 1)
            values += weight[:, None] * atlas[y, x]
    return values


def coverage(puppet: Puppet, layer: int) -> np.ndarray:
    """Mark the canvas pixels that a layer's mesh covers at least partly."""
    mask = np.zeros((puppet.canvas[1], puppet.canvas[0]), np.uint8)
    for triangle in puppet.triangles[puppet.layer_of_triangle == layer]:
        corners = np.round((puppet.vertices[triangle] - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(mask, [corners], 1, shift=4)
    return mask > 0


def joint_points(puppet: Puppet) -> np.ndarray:
    return np.einsum("jkc,jkcx->jkx", puppet.joint_weights, puppet.vertices[puppet.joint_vertices])


def test_layers_are_grouped_sound_and_in_one_piece():
    puppet = build(two_parts(), SETTINGS)
    assert puppet.names == ("body", "arm")
    assert puppet.reference == 7
    assert (np.diff(puppet.layer_of_vertex) >= 0).all()
    assert (puppet.layer_of_vertex[puppet.triangles] == puppet.layer_of_triangle[:, None]).all()
    assert components(puppet.triangles, len(puppet.vertices))[0] == 2
    assert smallest_angles(puppet.vertices, puppet.triangles).min() >= 20.0


def test_alpha_is_zero_along_every_mesh_border():
    cutout = two_parts()
    halo = cutout.parts[0].rgba.copy()
    halo[..., 3] = np.maximum(halo[..., 3], 12)  # a faint glow over the whole canvas, as scans have
    puppet = build(CutOut(SIZE, (Part("body", halo), cutout.parts[1])), SETTINGS)
    edges = boundary_edges(puppet.triangles)
    share = np.linspace(0.0, 1.0, 97)[:, None, None]
    points = (puppet.uv[edges[:, 0]] * (1.0 - share) + puppet.uv[edges[:, 1]] * share).reshape(-1, 2)
    assert sample(puppet.atlas, points)[:, 3].max() == 0.0


def test_the_atlas_at_rest_is_the_drawing():
    cutout = two_parts()
    puppet = build(cutout, SETTINGS)
    for layer, part in enumerate(cutout.parts):
        own = puppet.layer_of_vertex == layer
        shift = np.unique(np.round(puppet.uv[own] - puppet.vertices[own], 9), axis=0)
        assert len(shift) == 1
        np.testing.assert_array_equal(shift, np.round(shift))
        rows, columns = np.nonzero(part.rgba[..., 3])
        texels = puppet.atlas[rows + int(shift[0, 1]), columns + int(shift[0, 0])]
        np.testing.assert_array_equal(texels[:, 3], part.rgba[rows, columns, 3])
        sure = part.rgba[rows, columns, 3] >= 64
        np.testing.assert_array_equal(texels[sure], part.rgba[rows, columns][sure])


def test_the_mesh_reaches_the_margin_everywhere_and_not_much_further():
    cutout = two_parts()
    settings = PuppetSettings(edge=0.1, margin=6.0)
    puppet = build(cutout, settings)
    edge = settings.edge * max(rest_box(cutout, settings.least_alpha)[2:])
    for layer, part in enumerate(cutout.parts):
        from_drawing = cv2.distanceTransform((part.rgba[..., 3] < 128).astype(np.uint8), cv2.DIST_L2, 5)
        covered = coverage(puppet, layer)
        assert covered[from_drawing <= settings.margin].all()
        assert from_drawing[covered].max() <= settings.margin + 0.25 * edge + 1.5


def test_colour_is_bled_and_never_the_background():
    puppet = build(two_parts(), SETTINGS)
    body = puppet.layer_of_vertex == 0
    (x0, y0), (x1, y1) = np.floor(puppet.uv[body].min(axis=0)), np.ceil(puppet.uv[body].max(axis=0))
    window = puppet.atlas[int(y0) - 8 : int(y1) + 8, int(x0) - 8 : int(x1) + 8, :3]
    assert (window == (200, 40, 40)).all()


def test_windows_do_not_touch():
    puppet = build(two_parts(), SETTINGS)
    low = np.array([puppet.uv[puppet.layer_of_vertex == layer].min(axis=0) for layer in range(2)])
    high = np.array([puppet.uv[puppet.layer_of_vertex == layer].max(axis=0) for layer in range(2)])
    assert low.min() >= 8.0
    assert (high.max(axis=0) <= np.array(puppet.atlas.shape[1::-1]) - 8.0).all()
    assert (np.maximum(low[0] - high[1], low[1] - high[0]) >= 16.0).any()


def test_joints_stand_where_asked_or_in_the_overlap_and_coincide():
    given, guessed = JointSpec(("body", "arm"), (131.3, 97.1)), JointSpec(("arm", "body"))
    far = JointSpec(("body", "arm"), (20.0, 20.0))
    cutout = two_parts(given, guessed, far)
    puppet = build(cutout, SETTINGS)
    places = joint_points(puppet)
    np.testing.assert_allclose(places[:, 0], places[:, 1], atol=1e-9)
    np.testing.assert_allclose(places[0, 0], given.at, atol=1e-9)
    np.testing.assert_allclose(places[2, 0], far.at, atol=1e-9)
    rows, columns = np.nonzero((cutout.parts[0].rgba[..., 3] >= 16) & (cutout.parts[1].rgba[..., 3] >= 16))
    np.testing.assert_allclose(places[1, 0], [columns.mean() + 0.5, rows.mean() + 0.5], atol=1e-9)
    np.testing.assert_array_equal(puppet.joint_layers, [[0, 1], [1, 0], [0, 1]])
    np.testing.assert_array_equal(
        puppet.layer_of_vertex[puppet.joint_vertices], puppet.joint_layers[..., None].repeat(3, 2)
    )
    assert puppet.joint_weights[:2].min() >= 0.0
    np.testing.assert_allclose(puppet.joint_weights.sum(axis=2), 1.0)


def test_a_joint_of_parts_apart_stands_halfway():
    parts = Part("a", bar(20, 50, 60, 90, (1, 2, 3))), Part("b", bar(100, 60, 160, 80, (4, 5, 6)))
    puppet = build(CutOut(SIZE, parts, (JointSpec(("a", "b")),)), SETTINGS)
    x, y = joint_points(puppet)[0, 0]
    assert x == pytest.approx(80.0)
    assert 60.0 <= y <= 80.0


def test_islands_are_bridged_when_near_specks_dropped_and_holes_kept_when_large():
    picture = bar(20, 20, 100, 100, (9, 9, 9)) + bar(112, 40, 180, 80, (9, 9, 9))
    picture[180:182, 200:202] = 255
    picture[40:80, 40:80, 3] = 0
    picture[25:28, 25:28, 3] = 0
    puppet = build(CutOut(SIZE, (Part("all", picture),)), PuppetSettings(edge=0.1, bridge=0.1))
    assert components(puppet.triangles, len(puppet.vertices))[0] == 1
    assert puppet.vertices[:, 0].max() < 195.0
    border, _ = components(boundary_edges(puppet.triangles)[:, [0, 1, 1]], len(puppet.vertices))
    num_inner = len(puppet.vertices) - len(np.unique(boundary_edges(puppet.triangles)))
    assert border - num_inner == 2  # the outer border and one hole
    apart = build(CutOut(SIZE, (Part("all", picture),)), PuppetSettings(edge=0.03, margin=3.0, bridge=0.0))
    assert components(apart.triangles, len(apart.vertices))[0] == 2


def test_a_part_cut_off_by_the_canvas_and_a_tiny_part_are_meshed():
    parts = Part("low", bar(0, 150, 240, 200, (1, 2, 3))), Part("eye", bar(100, 60, 103, 62, (4, 5, 6)))
    puppet = build(CutOut(SIZE, parts), SETTINGS)
    assert puppet.vertices[:, 1].max() > SIZE[1] + 3.0
    assert (puppet.layer_of_triangle == 1).sum() >= 4


def test_subdivision_quadruples_the_triangles_and_the_mesh_is_the_same_every_time():
    coarse, again = build(two_parts(), SETTINGS), build(two_parts(), SETTINGS)
    fine = build(two_parts(), PuppetSettings(edge=0.1, subdivide=1))
    np.testing.assert_array_equal(coarse.vertices, again.vertices)
    np.testing.assert_array_equal(coarse.atlas, again.atlas)
    assert len(fine.triangles) == 4 * len(coarse.triangles)
    assert 300 <= len(build(two_parts(), PuppetSettings(edge=0.04)).vertices) <= 900


def test_a_part_without_pixels_is_refused():
    with pytest.raises(PuppetError, match="'none'"):
        build(CutOut(SIZE, (Part("none", blank()),)), SETTINGS)
