"""LabelMe and COCO over a frame; masks are compared with pycocotools, hidden parts with what the frame shows."""

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pycocotools import mask as coco_mask

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports import formats
from wildpuppet.puppet.imports.from_frame import read_coco, read_labelme, read_outlined
from wildpuppet.types import JointSpec

BLUE, RED, GREEN = (40, 60, 200), (220, 30, 30), (20, 160, 40)
SIZE = (120, 100)
BODY = [[20.0, 20.0], [80.0, 20.0], [80.0, 80.0], [20.0, 80.0]]
ARM = [[60.0, 40.0], [110.0, 40.0], [110.0, 60.0], [60.0, 60.0]]


def picture() -> np.ndarray:
    frame = np.full((SIZE[1], SIZE[0], 3), GREEN, np.uint8)
    frame[20:80, 20:80] = BLUE
    frame[40:60, 60:110] = RED
    return frame


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    Image.fromarray(picture()).save(tmp_path / "frame.png")
    return tmp_path / "frame.png"


def saved(folder: Path, tree: object) -> Path:
    path = folder / "outlines.json"
    path.write_text(json.dumps(tree))
    return path


def labelme(*shapes: dict[str, Any], **more: object) -> dict[str, object]:
    full = [{"group_id": None, "shape_type": "polygon", "flags": {}, **shape} for shape in shapes]
    return {"version": "5.5.0", "flags": {}, "shapes": full, "imagePath": "frame.png", "imageData": None, **more}


def coco(*segmentations: object, names: tuple[str, ...] = ("body", "arm"), **more: object) -> dict[str, object]:
    return {
        "images": [{"id": 7, "file_name": "frame.png", "width": SIZE[0], "height": SIZE[1]}],
        "categories": [{"id": index + 1, "name": name} for index, name in enumerate(names)],
        "annotations": [
            {"id": index, "image_id": 7, "category_id": index + 1, "segmentation": area, "iscrowd": 0}
            for index, area in enumerate(segmentations)
        ],
        **more,
    }


def flat(points: list[list[float]]) -> list[float]:
    return [value for point in points for value in point]


@pytest.mark.parametrize("kind", ["labelme", "coco"])
def test_what_an_arm_hides_is_filled_in_behind_it(tmp_path: Path, frame: Path, kind: str) -> None:
    trees = {
        "labelme": labelme({"label": "body", "points": BODY}, {"label": "arm", "points": ARM}),
        "coco": coco([flat(BODY)], [flat(ARM)]),
    }
    path = saved(tmp_path, trees[kind])
    assert formats.recognised(path) == kind
    body, arm = formats.read_puppet(path).cutout.parts
    assert (body.name, arm.name) == ("body", "arm")
    assert (body.rgba[20:80, 20:80] == (*BLUE, 255)).all()
    assert (arm.rgba[40:60, 60:110] == (*RED, 255)).all()
    assert formats.read_puppet(path).cutout.joints == (JointSpec(("body", "arm")),)


def test_labelme_pieces_rectangles_circles_and_hinges(tmp_path: Path, frame: Path) -> None:
    tree = labelme(
        {"label": "body", "shape_type": "rectangle", "points": [[80.0, 20.0], [20.0, 80.0]]},
        {"label": "spots", "group_id": 3, "points": [[25.0, 25.0], [35.0, 25.0], [35.0, 35.0], [25.0, 35.0]]},
        {"label": "spots", "group_id": 3, "points": [[30.0, 30.0], [30.0, 40.0], [40.0, 40.0], [40.0, 30.0]]},
        {"label": "ball", "shape_type": "circle", "points": [[50.0, 60.0], [50.0, 70.0]]},
        {"label": "body+ball", "shape_type": "point", "points": [[51.5, 60.5]]},
    )
    found = read_labelme(saved(tmp_path, tree), None).cutout
    areas = {part.name: float(part.rgba[..., 3].sum()) / 255 for part in found.parts}
    assert areas["body"] == 3600.0
    assert areas["spots"] == 100 + 100 - 25
    assert areas["ball"] == pytest.approx(np.pi * 100, rel=0.01)
    assert found.joints[0] == JointSpec(("body", "ball"), (51.5, 60.5))
    assert found.joints[1] == JointSpec(("body", "spots"))


def test_labelmes_embedded_picture_is_the_frame(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    Image.fromarray(picture()).save(buffer, "PNG")
    tree = labelme({"label": "arm", "points": ARM}, imageData=base64.b64encode(buffer.getvalue()).decode())
    (arm,) = read_labelme(saved(tmp_path, tree), None).cutout.parts
    assert (arm.rgba[40:60, 60:110] == (*RED, 255)).all()


@pytest.mark.parametrize("text", [True, False], ids=["compressed", "plain"])
def test_coco_run_lengths_give_pycocotools_mask(tmp_path: Path, frame: Path, text: bool) -> None:
    wanted = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    wanted[np.hypot(*(np.indices(wanted.shape) - np.array([50, 60])[:, None, None])) < 30] = 1
    wanted[45:55, 50:70] = 0
    wanted[:, 0] = 1  # begins with a run of ones
    packed = coco_mask.encode(np.asfortranarray(wanted))
    counts = packed["counts"].decode()
    if not text:
        values = wanted.ravel(order="F").astype(int)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], values])))
        counts = np.diff([0, *edges, values.size]).tolist()
    tree = coco({"size": [SIZE[1], SIZE[0]], "counts": counts}, names=("ring",))
    (part,) = read_coco(saved(tmp_path, tree), None).cutout.parts
    assert np.array_equal(part.rgba[..., 3], 255 * wanted)
    assert np.array_equal(wanted, coco_mask.decode(packed))


def test_coco_polygons_cover_what_pycocotools_does(tmp_path: Path, frame: Path) -> None:
    angles = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    star = np.stack([60 + np.where(np.arange(9) % 2, 20, 40) * np.cos(angles), 50 + 40 * np.sin(angles)], axis=1)
    piece = np.array([(5.0, 5.0), (25.0, 5.0), (15.0, 30.0)])[::-1]
    polygons = [star.ravel().tolist(), piece.ravel().tolist()]
    (part,) = read_coco(saved(tmp_path, coco(polygons, names=("star",))), None).cutout.parts
    packed = coco_mask.merge(coco_mask.frPyObjects(polygons, SIZE[1], SIZE[0]))
    ours, theirs = part.rgba[..., 3] > 127, coco_mask.decode(packed) > 0
    assert (ours & theirs).sum() / (ours | theirs).sum() > 0.97  # pycocotools rounds edges outwards by half a pixel
    assert float(part.rgba[..., 3].sum()) / 255 == pytest.approx(float(coco_mask.area(packed)), rel=0.03)


def test_one_of_several_annotated_pictures_is_chosen_by_its_name(tmp_path: Path, frame: Path) -> None:
    tree = coco([flat(BODY)], [flat(ARM)], names=("leg", "leg"))
    tree["images"] = [{"id": 1, "file_name": "other.png", "width": 5, "height": 5}, *tree["images"]]  # type: ignore[misc]
    path = saved(tmp_path, tree)
    with pytest.raises(PuppetError, match=r"annotates 2 pictures \(other\.png, frame\.png"):
        read_coco(path, None)
    assert [part.name for part in read_coco(path, frame).cutout.parts] == ["leg", "leg 2"]


def test_reference_and_halo_overrule_the_file(tmp_path: Path, frame: Path) -> None:
    path = saved(tmp_path, labelme({"label": "body", "points": BODY}, {"label": "arm", "points": ARM}, reference=3))
    assert read_labelme(path, None).cutout.reference == 3
    assert read_outlined(path, "labelme", frame, 150, 4).cutout.reference == 150
    with pytest.raises(PuppetError, match="expected 0 or more"):
        read_outlined(path, "labelme", frame, -1, None)
    with pytest.raises(PuppetError, match="no outlines; expected SVG, LabelMe or COCO"):
        read_outlined(path, "psd", frame, None, None)


RUNS = {"size": [SIZE[1], SIZE[0]]}


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (labelme({"label": "body", "points": [[1, 2], [3, 4], [float("nan"), 5]]}), "NaN is no number"),
        (labelme({"label": "body", "points": [[1, 2], [3, 4], [1e300, 5]]}), r"list of \[x, y\]"),
        (labelme({"label": "body", "points": [[1, 2]] * 30_000}), "30000 points; at most"),
        (labelme(*[{"label": "body", "points": BODY}] * 600), "600 shapes; at most"),
        (labelme({"label": "body", "points": BODY}, imagePath="../../etc/passwd"), "lies outside its folder"),
        (labelme({"label": "body", "points": BODY}, imagePath="C:\\frame.png"), "lies outside its folder"),
        (labelme({"label": "body", "points": BODY}, imagePath="none.png"), "add --frame"),
        (labelme({"label": "body", "points": BODY}, imageData="!!"), "not base64"),
        (labelme({"label": "body", "points": BODY}, imageWidth=5, imageHeight=5), "drawn on a 5x5 picture"),
        (coco([flat(BODY)[:-1]]), "list x1, y1, x2, y2"),
        (coco("rubbish"), "polygons or a run-length mask"),
        (coco({**RUNS, "counts": [5, -5]}), "whole numbers or COCO's text"),
        (coco({**RUNS, "counts": [5, 10**12]}), "add up to"),
        (coco({**RUNS, "counts": "\x7f\x7f"}), "no run length|do not fit"),
        (coco({**RUNS, "counts": "o" * 5000}), "no run length|do not fit|add up"),
        (coco({"size": [10**6, 10**6], "counts": [10**12]}), "mask of size"),
        (coco([flat(BODY)], images=[{"id": 7, "width": 10**6, "height": 10**6}]), "too big"),
        (coco([flat(BODY)], images=[]), "list 'images'"),
        (coco(images=[{"id": 7, "file_name": "frame.png", "width": 120, "height": 100}]), "at least one outlined part"),
    ],
)
def test_hostile_outlines_are_refused_in_one_line(
    tmp_path: Path, frame: Path, tree: dict[str, Any], words: str
) -> None:
    path = saved(tmp_path, tree)
    with pytest.raises(PuppetError, match=words) as caught:
        (read_labelme if "shapes" in tree else read_coco)(path, None)
    assert "\n" not in str(caught.value)


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.json"
    path.write_text('{"shapes": ' + "[" * 200_000 + "]" * 200_000 + "}")
    for read in (lambda: formats.recognised(path), lambda: read_labelme(path, None)):
        with pytest.raises(PuppetError, match="not usable JSON"):
            read()
