import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.coverage import polygon_coverage
from wildpuppet.puppet.folder import read_cutout
from wildpuppet.puppet.imports.labelme import read_outlines
from wildpuppet.puppet.outlines import Outline, Outlines, Stencil, cutout_from_outlines
from wildpuppet.types import JointSpec

EXAMPLES = Path(__file__).parents[2] / "examples"
BACKGROUND, BLUE, RED = (20, 160, 40), (40, 60, 200), (220, 30, 30)
BODY = np.array([(20.0, 20.0), (80.0, 20.0), (80.0, 80.0), (20.0, 80.0)])
ARM = np.array([(60.0, 40.0), (110.0, 40.0), (110.0, 60.0), (60.0, 60.0)])


@pytest.fixture
def frame() -> np.ndarray:
    """A blue body with a red arm across its right edge."""
    picture = np.full((100, 120, 3), BACKGROUND, np.uint8)
    picture[20:80, 20:80] = BLUE
    picture[40:60, 60:110] = RED
    return picture


def drawn(*parts: tuple[str, np.ndarray], joints: tuple[JointSpec, ...] = ()) -> Outlines:
    return Outlines(tuple(Outline(name, points) for name, points in parts), joints)


def saved(folder: Path, shapes: object, **others: object) -> Path:
    path = folder / "outlines.json"
    path.write_text(json.dumps({"shapes": shapes, **others}))
    return path


def test_a_part_in_front_leaves_no_picture_of_itself_on_the_part_behind(frame: np.ndarray) -> None:
    body, arm = cutout_from_outlines(frame, drawn(("body", BODY), ("arm", ARM))).parts
    assert (body.rgba[20:80, 20:80] == (*BLUE, 255)).all()
    assert (arm.rgba[40:60, 60:110] == (*RED, 255)).all()
    assert not body.rgba[:, 80:, 3].any()


def test_colour_runs_on_outside_the_outline_without_the_background(frame: np.ndarray) -> None:
    outlines = drawn(("body", BODY), ("arm", ARM))
    body, arm = cutout_from_outlines(frame, outlines, bleed=5).parts
    assert (body.rgba[15:20, 20:80] == (*BLUE, 0)).all()
    assert (arm.rgba[45:55, 110:115] == (*RED, 0)).all()
    assert not body.rgba[:14].any()


def test_stacked_parts_give_the_frame_back(frame: np.ndarray) -> None:
    stack = np.full(frame.shape, BACKGROUND, np.float64)
    for part in cutout_from_outlines(frame, drawn(("body", BODY), ("arm", ARM))).parts:
        alpha = part.rgba[..., 3:] / 255.0
        stack = (1 - alpha) * stack + alpha * part.rgba[..., :3]
    assert np.array_equal(np.rint(stack).astype(np.uint8), frame)


def test_drawn_detail_is_kept_where_seen_and_smooth_where_hidden(frame: np.ndarray) -> None:
    frame[20:80, 20:80, 0] = np.linspace(0, 120, 60, dtype=np.uint8)[:, None]
    body, _ = cutout_from_outlines(frame, drawn(("body", BODY), ("arm", ARM))).parts
    assert np.array_equal(body.rgba[20:80, 20:50, :3], frame[20:80, 20:50])
    hidden = body.rgba[40:60, 66:80, 0].astype(int)
    # The gradient across the hidden 20 rows runs from 40 to 80: the fill must lie between and have no jump beyond it.
    assert hidden.min() >= 30
    assert hidden.max() <= 90
    assert np.abs(np.diff(hidden, axis=0)).max() <= 20


def test_coverage_is_the_area_of_each_pixel_inside_the_polygon() -> None:
    corners = np.array([(10.25, 5.0), (20.5, 5.0), (20.5, 8.75), (10.25, 8.75)])
    coverage = polygon_coverage(corners, (40, 30))
    # An eighth of a pixel: the sampling raster.
    assert coverage.sum() == pytest.approx(10.25 * 3.75, abs=(10.25 + 3.75) * 2 / 8)
    assert coverage[6, 10] == pytest.approx(0.75, abs=1 / 8)
    assert coverage[6, 20] == pytest.approx(0.5, abs=1 / 8)
    assert coverage[6, 15] == 1
    assert coverage[6, 21] == 0


def test_coverage_of_a_slanted_edge_ramps_over_about_one_pixel() -> None:
    circle = cv2.ellipse2Poly((0, 0), (1000, 1000), 0, 0, 360, 2) / 1000.0 * 12.3 + (20.0, 20.0)
    coverage = polygon_coverage(circle, (40, 40))
    rows, columns = np.mgrid[:40, :40] + 0.5
    distance = np.hypot(rows - 20.0, columns - 20.0) - 12.3
    assert (coverage[distance < -0.8] == 1).all()
    assert (coverage[distance > 0.8] == 0).all()
    assert np.abs(coverage - np.clip(0.5 - distance, 0, 1)).max() < 0.2


def test_a_part_may_reach_beyond_the_frame(frame: np.ndarray) -> None:
    wide = np.array([(-50.0, 40.0), (30.0, 40.0), (30.0, 300.0), (-50.0, 300.0)])
    (part,) = cutout_from_outlines(frame, drawn(("wide", wide))).parts
    assert (part.rgba[40:, :30, 3] == 255).all()
    assert not part.rgba[:39, :, 3].any()


def test_labelme_files_are_read_in_order_with_hinges(tmp_path: Path, frame: np.ndarray) -> None:
    shapes = [
        {"label": "body", "points": BODY.tolist(), "shape_type": "polygon"},
        {"label": "body+arm", "points": [[64.5, 50.0]], "shape_type": "point"},
        {"label": "arm", "points": ARM.tolist()},
    ]
    path = saved(tmp_path, shapes, imageWidth=120, imageHeight=100, reference=7, halo=2, flags={}, imageData=None)
    outlines = read_outlines(path)
    assert outlines.halo == 2
    cutout = cutout_from_outlines(frame, outlines)
    assert [part.name for part in cutout.parts] == ["body", "arm"]
    assert cutout.joints == (JointSpec(("body", "arm"), (64.5, 50.0)),)
    assert cutout.canvas == (120, 100)
    assert cutout.reference == 7


@pytest.mark.parametrize(
    ("shapes", "expected"),
    [
        ({}, "list 'shapes'"),
        ([{"points": [[1, 2]]}], "no label"),
        ([{"label": "a", "points": "none"}], r"list of \[x, y\]"),
        ([{"label": "a", "points": [[1, 2, 3]]}], r"list of \[x, y\]"),
        ([{"label": "a", "points": [[1, 2], [3]]}], r"list of \[x, y\]"),
        ([{"label": "a", "points": [[1, 2]], "shape_type": "circle"}], "'circle'"),
        ([{"label": "a", "points": [[1, 2]], "shape_type": "point"}], r"torso\+head"),
        ([{"label": "a+", "points": [[1, 2]], "shape_type": "point"}], r"torso\+head"),
        ([7], "no label"),
    ],
)
def test_shapes_that_cannot_be_used_are_named(tmp_path: Path, shapes: object, expected: str) -> None:
    with pytest.raises(PuppetError, match=expected) as caught:
        read_outlines(saved(tmp_path, shapes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("others", [{"halo": -1}, {"reference": 1.5}, {"imageWidth": "wide"}])
def test_fields_out_of_range_are_named(tmp_path: Path, others: dict[str, object]) -> None:
    with pytest.raises(PuppetError, match=f"{next(iter(others))} is .*whole number"):
        read_outlines(saved(tmp_path, [], **others))


def test_unreadable_outline_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(PuppetError, match="expected a file, found nothing"):
        read_outlines(tmp_path / "nothing.json")
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(PuppetError, match="not valid JSON at line 1"):
        read_outlines(tmp_path / "broken.json")
    (tmp_path / "list.json").write_text("[]")
    with pytest.raises(PuppetError, match="found list"):
        read_outlines(tmp_path / "list.json")


@pytest.mark.parametrize(
    ("outlines", "expected"),
    [
        (Outlines(()), "at least one"),
        (Outlines((Outline("body", BODY),), canvas=(10, 10)), "10x10 picture, the frame is 120x100"),
        (drawn(("body", BODY), ("body", ARM)), "two outlines are named 'body'"),
        (drawn(("body", BODY[:2])), "at least 3"),
        (drawn(("body", BODY * np.nan)), "not a number"),
        (drawn(("body", BODY + 500.0)), "wholly outside"),
        (drawn(("under", BODY), ("over", BODY)), "'under' shows no pixel"),
        (drawn(("line", np.array([(5.0, 5.0), (50.0, 5.0), (90.0, 5.0)]))), "'line' shows no pixel"),
        (drawn(("body", BODY), joints=(JointSpec(("body", "head")),)), r"hinge body\+head"),
        (drawn(("body", BODY), joints=(JointSpec(("body", "body")),)), r"hinge body\+body"),
    ],
)
def test_outlines_that_contradict_the_frame_are_refused(frame: np.ndarray, outlines: Outlines, expected: str) -> None:
    with pytest.raises(PuppetError, match=expected) as caught:
        cutout_from_outlines(frame, outlines)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["bluto", "bunny"])
def test_example_puppets_are_what_their_outlines_say(name: str) -> None:
    folder = EXAMPLES / name / "puppet"
    frame = np.asarray(Image.open(folder / "reference.png").convert("RGB"))
    expected = cutout_from_outlines(frame, read_outlines(folder / "outlines.json"))
    found = read_cutout(folder)
    assert [part.name for part in found.parts] == [part.name for part in expected.parts]
    assert found.joints == expected.joints
    assert found.reference == expected.reference
    for part, other in zip(found.parts, expected.parts, strict=True):
        # One grey level: blurs may round differently on another processor.
        assert np.abs(part.rgba.astype(int) - other.rgba).max() <= 1


def test_a_part_of_several_rings_and_one_given_as_a_mask(frame: np.ndarray) -> None:
    hole = np.array([(25.0, 25.0), (35.0, 25.0), (35.0, 35.0), (25.0, 35.0)])
    body = Outline("body", BODY, (hole,))
    mask = np.zeros(frame.shape[:2], bool)
    mask[40:60, 60:110] = True
    parts = cutout_from_outlines(frame, Outlines((body, Stencil("arm", mask)))).parts
    assert (parts[0].rgba[25:35, 25:35, 3] == 0).all()
    assert (parts[0].rgba[40:60, 60:80] == (*BLUE, 255)).all()
    assert np.array_equal(parts[1].rgba[..., 3], 255 * mask)
    with pytest.raises(PuppetError, match="its mask is 120x90, the frame is 120x100"):
        cutout_from_outlines(frame, Outlines((Stencil("arm", mask[:90]),)))
