"""Outlines in SVG as Inkscape and Illustrator write them, against resvg's rendering of the same shapes."""

import base64
import io
from pathlib import Path

import numpy as np
import pytest
import resvg_py
from PIL import Image

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.imports.from_frame import drawn_svg, read_svg
from wildpuppet.puppet.imports.svg import outlines_of, read_drawing
from wildpuppet.puppet.outlines import Outlines
from wildpuppet.types import JointSpec

SIZE = (200, 100)
SPACES = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)


def saved(folder: Path, inside: str, attributes: str = 'viewBox="0 0 200 100"', head: str = "") -> Path:
    path = folder / "outlines.svg"
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>{head}<svg {SPACES} {attributes}>{inside}</svg>')
    return path


def outlines(path: Path, size: tuple[int, int] = SIZE) -> Outlines:
    return outlines_of(read_drawing(path), size, path)


def rendered(shape: str, attributes: str = 'viewBox="0 0 200 100"', width: int = SIZE[0]) -> np.ndarray:
    """Coverage by resvg, 0..1."""
    data = resvg_py.svg_to_bytes(svg_string=f"<svg {SPACES} {attributes}>{shape}</svg>", width=width)
    return np.asarray(Image.open(io.BytesIO(bytes(data))).convert("RGBA"))[..., 3] / 255.0


SHAPES = {
    "path": '<path {} d="M 30 20 C 90 -10 160 20 150 60 S 90 100 60 70 q -30 0 -30 -20 t 5 -20 Z"/>',
    "arcs": '<path {} d="M 40 50 a 40 20 30 1 0 60 -10 A 15 25 -20 0 1 130 60 L 90 90 H 50 V 70 z"/>',
    "hole": '<path {} fill-rule="evenodd" d="M20 10H120V90H20ZM40 30h50v40h-50z"/>',
    "nonzero": '<path {} d="M20 10H120V90H20ZM40 30h50v40h-50z"/>',
    "rect": '<rect {} x="30" y="20" width="120" height="60" rx="20" ry="30"/>',
    "square": '<rect {} x="30.5" y="20.25" width="120" height="60"/>',
    "ellipse": '<ellipse {} cx="100" cy="50" rx="70" ry="30"/>',
    "circle": '<circle {} cx="100" cy="50" r="30"/>',
    "polygon": '<polygon {} points="20,10 150,30,-1e1 60 90.5,.5e2"/>',
}
TRANSFORMS = ("", 'transform="translate(12,-3) rotate(20 100 50) skewX(15) scale(.8,1.1)"')


@pytest.mark.parametrize("transform", TRANSFORMS, ids=["plain", "transformed"])
@pytest.mark.parametrize("kind", SHAPES)
def test_shapes_cover_what_resvg_paints(tmp_path: Path, kind: str, transform: str) -> None:
    named = SHAPES[kind].format('id="torso"')
    shape = f'<g {transform}><g transform="translate(3 4)">{named}</g></g>'
    (part,) = outlines(saved(tmp_path, shape)).parts
    difference = np.abs(part.coverage(SIZE) - rendered(shape))
    # resvg rounds coverage to its own raster: a quarter of a pixel along x, a quarter along y.
    assert difference.max() <= 0.3
    assert difference.sum() <= 0.02 * rendered(shape).sum() + 2.0


def test_names_groups_and_hinges_are_a_persons_not_the_programs(tmp_path: Path) -> None:
    inside = """
      <defs><path id="template" d="M0 0H9V9Z"/></defs>
      <g inkscape:groupmode="layer" inkscape:label="Layer 1" id="layer1">
        <path id="path10" inkscape:label="torso" d="M 10 10 H 60 V 90 H 10 Z"/>
        <g id="arm"><rect id="rect1" x="50" y="20" width="40" height="10"/>
          <rect id="rect2" x="80" y="15" width="30" height="20"/></g>
        <path id="path11" d="M 20 5 H 40 V 20 H 20 Z"><title>head</title></path>
        <circle id="circle5" inkscape:label="torso + arm" cx="55" cy="25" r="3"/>
        <path id="torso_x002B_head" d="M 29 12 H 31 V 16 H 29 Z"/>
        <path id="path12" inkscape:label="sketch" style="fill:red; display:none" d="M0 0H9V9Z"/>
        <text>remember</text>
      </g>"""
    drawing = read_drawing(saved(tmp_path, inside))
    found = outlines_of(drawing, SIZE, tmp_path)
    assert [part.name for part in found.parts] == ["torso", "arm", "head"]
    assert found.joints == (JointSpec(("torso", "arm"), (55.0, 25.0)), JointSpec(("torso", "head"), (30.0, 14.0)))
    # Two overlapping pieces are one area: 40 x 10 + 30 x 20 - 10 x 10.
    assert found.parts[1].coverage(SIZE).sum() == pytest.approx(900.0)
    assert drawing.notes == ["'sketch' is hidden and left out", "a <text> is left out; outlines are paths and shapes"]


def test_figmas_pictures_are_no_parts(tmp_path: Path) -> None:
    inside = """<rect width="200" height="100" fill="url(#pattern0)"/><path id="torso" d="M 10 10 H 60 V 90 H 10 Z"/>
      <defs><pattern id="pattern0" width="1" height="1"><use xlink:href="#image0"/></pattern></defs>"""
    drawing = read_drawing(saved(tmp_path, inside))
    assert [part.name for part in outlines_of(drawing, SIZE, tmp_path).parts] == ["torso"]
    assert drawing.notes == ["'rect' shows a picture and is left out"]


def test_shapes_without_names_are_told(tmp_path: Path) -> None:
    """Inkscape's "plain SVG" drops the labels."""
    Image.new("RGB", SIZE).save(tmp_path / "frame.png")
    path = saved(tmp_path, '<g id="g1"><path id="path1" d="M0 0H90V9Z"/><path id="path2" d="M20 20H90V90Z"/></g>')
    drawn = drawn_svg(path, tmp_path / "frame.png")
    assert [part.name for part in drawn.outlines.parts] == ["part", "part 2"]
    assert "no shape bears a name" in drawn.notes[0]


def test_a_piece_with_a_hole_keeps_it_beside_other_pieces(tmp_path: Path) -> None:
    inside = """<g id="arm"><path fill-rule="evenodd" d="M 0 0 H 40 V 40 H 0 Z M 10 10 H 30 V 30 H 10 Z"/>
      <path d="M 50 0 V 20 H 60 V 0 Z"/></g><path id="leg" d="M 90 0 h 5 v 5 h -5 z"/>"""
    assert outlines(saved(tmp_path, inside)).parts[0].coverage(SIZE).sum() == pytest.approx(1600 - 400 + 200)


def test_unnamed_shapes_of_one_layer_are_parts_of_their_own(tmp_path: Path) -> None:
    inside = '<g inkscape:label="Ebene 1"><path id="path1" d="M0 0H9V9Z"/><path id="path2" d="M20 0H29V9Z"/></g>'
    assert [part.name for part in outlines(saved(tmp_path, inside)).parts] == ["Ebene 1", "Ebene 1 2"]


def test_the_frame_lies_where_the_image_lies(tmp_path: Path) -> None:
    """The frame is 100 x 100, letterboxed in its turned <image>: resvg draws the same frame with one marked square."""
    frame = np.zeros((100, 100, 4), np.uint8)
    frame[30:60, 20:70] = 255
    Image.fromarray(frame).save(tmp_path / "frame.png")
    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, "PNG")
    data = f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
    placed = (
        '<g transform="rotate(10) translate(40 5)"><image x="5" y="6" width="120" height="80" xlink:href="{}"/></g>'
    )
    # The marked square's corners in the document: 80/100 per pixel, 20 of letterbox on either side.
    corners = [(5 + 20 + 0.8 * x, 6 + 0.8 * y) for x, y in ((20, 30), (70, 30), (70, 60), (20, 60))]
    points = " ".join(f"{x},{y}" for x, y in corners)
    square = f'<g transform="rotate(10) translate(40 5)"><polygon id="square" points="{points}"/></g>'
    # Our corners do lie where resvg paints the square.
    painted, outlined = rendered(placed.format(data)), rendered(square)
    assert np.abs(painted - outlined).sum() < 0.05 * outlined.sum()
    hidden = '<g style="display:none"><g>{}</g><path id="notes" d="M0 0H9V9Z"/></g>'
    for picture in (placed.format(data), placed.format("frame.png"), hidden.format(placed.format("frame.png"))):
        path = saved(tmp_path, picture + square)
        drawn = drawn_svg(path, None)
        assert drawn.rgb.shape == (100, 100, 3)
        (part,) = drawn.outlines.parts
        assert np.abs(part.coverage((100, 100)) - (frame[..., 3] > 0)).max() < 1e-6


def test_the_view_box_or_the_size_is_the_frame_where_there_is_no_image(tmp_path: Path) -> None:
    shape = '<rect id="torso" x="60" y="20" width="50" height="30"/>'
    for attributes in ('viewBox="10 20 100 50" width="40mm"', 'viewBox="10 20 100 50"'):
        (part,) = outlines(saved(tmp_path, shape, attributes)).parts
        assert part.points.tolist() == [[100.0, 0.0], [200.0, 0.0], [200.0, 60.0], [100.0, 60.0]]
    (part,) = outlines(saved(tmp_path, shape, 'width="1in" height="48px"')).parts
    assert part.points[0] == pytest.approx(np.array([60.0, 20.0]) * (200 / 96))
    with pytest.raises(PuppetError, match="not of one shape; keep the frame's <image>"):
        outlines(saved(tmp_path, shape, 'viewBox="0 0 100 100"'))


TORSO = '<path id="torso" d="M 10 10 H 60 V 90 H 10 Z"/>'
LAUGHS = '<!DOCTYPE svg [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("inside", "head", "words"),
    [
        (f"{TORSO}<text>&b;</text>", LAUGHS, "EntitiesForbidden"),
        ("<g>" * 100 + TORSO + "</g>" * 100, "", "more than 64 deep"),
        ("<g", "", "XML that cannot be used"),
        ('<path id="torso" d="M 10 nope"/>', "", "path that cannot be read"),
        ('<path id="torso" d="M 0 0 L 1e999 0 L 5 5 Z"/>', "", "no usable numbers"),
        ('<path id="torso" d="M 0 0 A 0 0 0 0 0 nan 5 Z"/>', "", "path that cannot be read"),
        ('<path id="torso" d=""/>', "", "at least one outlined part"),
        ('<rect id="torso" x="NaN" width="5" height="5"/>', "", "'torso' x is 'NaN'"),
        ('<rect id="torso" width="50%" height="5"/>', "", "width is '50%'; expected a length"),
        (f'<g transform="matrix(1 2 3)">{TORSO}</g>', "", "transform that cannot be read"),
        (f'<g transform="scale(1e300)">{TORSO}</g>', "", "no usable numbers"),
        (f'<image width="9" height="9" xlink:href="../../etc/passwd"/>{TORSO}', "", "lies outside its folder"),
        (f'<image width="9" height="9" xlink:href="file:///etc/passwd"/>{TORSO}', "", "lies outside its folder"),
        (f'<image width="9" height="9" xlink:href="https://example.org/a.png"/>{TORSO}', "", "lies outside its folder"),
        (f'<image width="9" height="9" xlink:href="data:image/png;base64,AAAA"/>{TORSO}', "", "not a picture we read"),
        (f'<image width="9" height="9" xlink:href="none.png"/>{TORSO}', "", "found nothing"),
        (f'<image xlink:href="frame.png"/>{TORSO}', "", "no width and height"),
        (TORSO, "", "add --frame"),
        ("<text>empty</text>", "", "add --frame"),
    ],
)
def test_hostile_and_broken_drawings_are_refused_in_one_line(
    tmp_path: Path, inside: str, head: str, words: str
) -> None:
    frame = None
    if "add --frame" not in words and "<image" not in inside:
        frame = tmp_path / "frame.png"
        Image.new("RGB", SIZE).save(frame)
    with pytest.raises(PuppetError, match=words) as caught:
        read_svg(saved(tmp_path, inside, head=head), frame)
    assert "\n" not in str(caught.value)


def test_an_svg_of_too_many_points_is_refused(tmp_path: Path) -> None:
    points = " ".join(f"{x % 190},{x % 97}" for x in range(30_000))
    with pytest.raises(PuppetError, match="points are too many"):
        read_drawing(saved(tmp_path, f'<polygon id="torso" points="{points}"/>'))
