"""TAP-Vid, COCO and .flo against a puppet whose motion is known, read back by numpy, pycocotools and OpenCV."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO

from tests.correspond import scene
from tests.export.moving import BEHIND, FIRST, HELD, LOST, NUM_FRAMES, SHOT, moving
from wildpuppet.export import coco, flo, tapvid
from wildpuppet.export.options import Options
from wildpuppet.geometry.affine import apply, compose, invert
from wildpuppet.machine import silent

PIXELS = 1e-3
EDGE_SHARE = 0.01
"""Share of a mask's pixels along its edge that round to the other side of half coverage."""


@pytest.fixture(scope="module")
def world():
    return moving()


def ink(world, t):
    """Which rectangle shows at each pixel's centre: -1 none, by the maps alone."""
    width, height = world.animation.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    centres = np.stack([x, y], -1).reshape(-1, 2)
    shown = np.full(len(centres), -1)
    for layer in world.animation.order[t] if t != LOST else ():
        canvas = apply(invert(world.maps[t, layer]), centres)
        left, top, w, h = (scene.BODY, scene.ARM)[layer]
        inside = ((canvas >= (left, top)) & (canvas < (left + w, top + h))).all(1)
        shown[inside] = layer
    return shown.reshape(height, width)


def test_point_tracks_follow_the_motion_and_know_what_hides_them(tmp_path, world):
    manifest = tapvid.write(world.animation, tmp_path, Options(), silent)
    tracks = np.load(tmp_path / "hero_run.npz", allow_pickle=False)
    points, occluded = tracks["points"] * np.array([160, 120]), tracks["occluded"]
    assert points.shape[1:] == (NUM_FRAMES, 2)
    assert 700 < len(points) < 1100
    assert not occluded.all(1).any()
    assert occluded[:, LOST].all()
    layers = np.array([world.puppet.names.index(part) for part in tracks["part"]])
    for t in (1, HELD, BEHIND, SHOT):
        expected = np.array(
            [apply(compose(world.maps[t, k], invert(world.maps[0, k])), p[None])[0]
             for k, p in zip(layers, points[:, 0], strict=True)]
        )  # fmt: skip
        assert np.abs(points[:, t] - expected).max() < PIXELS
        shown = ink(world, t)
        inside = ((expected >= 0) & (expected < (160, 120))).all(1)
        x, y = np.clip(np.floor(expected).astype(int), 0, (159, 119)).T
        seen = inside & (shown[y, x] == layers)
        assert (seen == occluded[:, t]).mean() < EDGE_SHARE
    first = tracks["query_points"][:, 0].astype(int)
    assert not occluded[np.arange(len(points)), first].any()
    places = points[np.arange(len(points)), first]
    assert np.abs(tracks["query_points"][:, 1:] - places[:, ::-1]).max() < PIXELS
    assert "pictures" in manifest.left_out[0]
    assert "video" not in tracks


def test_point_tracks_carry_pictures_along(tmp_path, world):
    """TAP-Vid's own keys: video (T, H, W, 3) u8, points (N, T, 2) as shares, occluded (N, T)."""

    def picture(number):
        return np.full((120, 160, 3), (number, 2, 3), np.uint8)

    manifest = tapvid.write(world.animation, tmp_path, Options(pictures=picture), silent)
    with np.load(tmp_path / "hero_run.npz", allow_pickle=False) as tracks:
        video = tracks["video"]
        assert (video.shape, video.dtype) == ((NUM_FRAMES, 120, 160, 3), np.uint8)
        assert video[:, 0, 0, 0].tolist() == list(range(FIRST, FIRST + NUM_FRAMES))
        assert tracks["points"].shape[1] == NUM_FRAMES
    assert not any("pictures" in words for words in manifest.left_out)


def unsure(animation):
    """Confidence that grows along the arm and falls with time; the body's is 1."""
    layers, x = animation.puppet.layer_of_vertex, animation.puppet.vertices[:, 0]
    arm = np.clip((x - 86.0) / 58.0, 0.0, 1.0)
    return np.stack([np.where(layers == 1, arm * (1.0 - 0.1 * t), 1.0) for t in range(len(animation))])


def test_confidence_comes_along(tmp_path, world):
    animation = replace(world.animation, confidence=unsure(world.animation))
    tapvid.write(animation, tmp_path, Options(), silent)
    tracks = np.load(tmp_path / "hero_run.npz", allow_pickle=False)
    on_arm = tracks["part"] == "arm"
    assert np.allclose(tracks["confidence"][~on_arm], 1.0)
    x = tracks["points"][on_arm, 0, 0] * 160  # frame 0 is the puppet at rest
    for t in (0, 5):
        assert np.abs(tracks["confidence"][on_arm, t] - (x - 86.0) / 58.0 * (1.0 - 0.1 * t)).max() < 1e-3
    coco.write(animation, tmp_path, Options(), silent)
    read = COCO(tmp_path / "hero_run.json")
    for t in (0, 5):
        scores = {each["category_id"]: each["score"] for each in read.loadAnns(read.getAnnIds(imgIds=t + 1))}
        assert scores[2] == 1.0
        assert scores[3] == pytest.approx(0.5 * (1.0 - 0.1 * t), abs=1e-3)


def test_pycocotools_reads_masks_boxes_and_keypoints(tmp_path, world):
    coco.write(world.animation, tmp_path, Options(first_frame=1001), silent)
    read = COCO(tmp_path / "hero_run.json")
    assert [each["name"] for each in read.loadCats(read.getCatIds())] == ["character", "body", "arm"]
    images = read.loadImgs(read.getImgIds())
    assert [image["file_name"] for image in images[:2]] == ["001001.png", "001002.png"]
    assert [image["frame"] for image in images] == list(range(FIRST, FIRST + NUM_FRAMES))
    for t, image in enumerate(images):
        shown = ink(world, t)
        found = read.loadAnns(read.getAnnIds(imgIds=image["id"]))
        assert len(found) == (0 if t == LOST else 3)
        for annotation in found:
            mask = read.annToMask(annotation).astype(bool)
            layer = annotation["category_id"] - 2
            expected = shown >= 0 if layer < 0 else shown == layer
            assert (mask != expected).sum() <= EDGE_SHARE * expected.sum() + 60
            assert annotation["area"] == mask.sum() == coco_mask.area(read.annToRLE(annotation))
            assert annotation["bbox"] == coco_mask.toBbox(read.annToRLE(annotation)).tolist()
    whole = read.loadAnns(read.getAnnIds(imgIds=2, catIds=1))[0]
    corners = world.vertices(1)[world.puppet.joint_vertices[0]]
    x, y = np.einsum("kcd,kc->kd", corners, world.puppet.joint_weights[0]).mean(0)
    assert np.abs(np.subtract(whole["keypoints"], (x - 0.5, y - 0.5, 2))).max() < PIXELS


def test_our_run_lengths_are_pycocotools_own():
    rng = np.random.default_rng(0)
    masks = [rng.random((37, 53)) < share for share in (0.0, 0.02, 0.5, 0.98, 1.0)]
    masks += [np.pad(np.ones((300, 300), bool), 900)]
    for mask in masks:
        expected = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode()
        assert coco.compressed(coco.run_lengths(mask)) == expected


def test_opencv_reads_flow_that_is_the_motion(tmp_path, world):
    flo.write(world.animation, tmp_path, Options(), silent)
    pairs = [t for t in range(NUM_FRAMES - 1) if LOST not in (t, t + 1) and t + 1 != SHOT]
    assert sorted(file.name for file in tmp_path.iterdir()) == [f"{FIRST + t:06d}.flo" for t in pairs]
    for t in pairs:
        flow = cv2.readOpticalFlow(str(tmp_path / f"{FIRST + t:06d}.flo"))
        shown = ink(world, t)
        known = flow[..., 0] < 1e9
        assert (known != (shown >= 0)).mean() < EDGE_SHARE
        rows, columns = np.nonzero(known & (shown >= 0))
        centres = np.stack([columns, rows], 1) + 0.5
        for layer in range(2):
            mine = shown[rows, columns] == layer
            goal = apply(compose(world.maps[t + 1, layer], invert(world.maps[t, layer])), centres[mine])
            wrong = np.abs(flow[rows[mine], columns[mine]] - (goal - centres[mine])).max(1) > PIXELS
            assert wrong.mean() < EDGE_SHARE  # half-covered pixels at the seam may show the other part


def test_puppets_without_hinges_have_no_keypoints(tmp_path, world):
    none = np.zeros((0, 2), np.int64)
    loose = replace(
        world.puppet, joint_layers=none, joint_vertices=np.zeros((0, 2, 3), np.int64), joint_weights=np.zeros((0, 2, 3))
    )
    coco.write(replace(world.animation, puppet=loose), tmp_path, Options(), silent)
    tree = json.loads((tmp_path / "hero_run.json").read_text())
    assert tree["categories"][0]["keypoints"] == []
