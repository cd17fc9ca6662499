"""From another program's file to a puppet that the check is content with, by the command line."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from psd_tools import PSDImage

from pipelines.cli import run_command
from wildpuppet.puppet.folder import read_cutout

SIZE = (240, 200)


def drawn(start: tuple[int, int], end: tuple[int, int], width: int, colour: tuple[int, int, int]) -> np.ndarray:
    picture = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    cv2.line(picture, start, end, (*colour, 255), width, cv2.LINE_8)
    return picture


PARTS = {
    "body": drawn((80, 70), (80, 130), 70, (40, 60, 200)),
    "upper arm": drawn((105, 70), (150, 90), 30, (220, 30, 30)),
    "forearm": drawn((150, 90), (200, 60), 24, (230, 160, 30)),
}


@pytest.fixture
def psd(tmp_path: Path) -> Path:
    document = PSDImage.new("RGBA", SIZE)
    for name, picture in PARTS.items():
        rows, columns = np.nonzero(picture[..., 3])
        top, left = rows.min(), columns.min()
        cut = picture[top : rows.max() + 1, left : columns.max() + 1]
        document.create_pixel_layer(Image.fromarray(cut), name=name, top=int(top), left=int(left))
    document.save(tmp_path / "figure.psd")
    return tmp_path / "figure.psd"


def test_a_psd_becomes_a_puppet_that_passes_the_check(
    psd: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "puppet"
    assert run_command(["puppet", "import", str(psd), "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "3 parts on 240 x 200, back to front: body, upper arm, forearm" in told
    assert "2 guessed from overlaps" in told
    cutout = read_cutout(out)
    for part, (name, picture) in zip(cutout.parts, PARTS.items(), strict=True):
        assert part.name == name
        assert np.array_equal(part.rgba, picture)
    assert [joint.parts for joint in cutout.joints] == [("body", "upper arm"), ("upper arm", "forearm")]
    assert run_command(["puppet", "check", str(out)]) == 0
    assert (out / "overlay.png").is_file()


def test_outlines_over_a_frame_become_the_same_puppet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    for picture in PARTS.values():
        frame[picture[..., 3] > 0] = picture[picture[..., 3] > 0][:, :3]
    Image.fromarray(frame).save(tmp_path / "frame.png")
    shapes, paths = [], []
    for name, picture in PARTS.items():
        (ring,), _ = cv2.findContours((picture[..., 3] > 0).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        points = ring[:, 0].astype(float) + 0.5
        shapes.append({"label": name, "points": points.tolist(), "shape_type": "polygon"})
        paths.append(f'<path id="{name}" d="M {" L ".join(f"{x} {y}" for x, y in points)} Z"/>')
    shapes.append({"label": "body+upper arm", "points": [[105.0, 70.0]], "shape_type": "point"})
    (tmp_path / "outlines.json").write_text(json.dumps({"shapes": shapes}))
    viewed = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 240 200">{"".join(paths)}</svg>'
    (tmp_path / "outlines.svg").write_text(viewed)
    for kind in ("json", "svg"):
        out = tmp_path / kind
        words = ["puppet", "from-outlines", str(tmp_path / "frame.png"), str(tmp_path / f"outlines.{kind}")]
        assert run_command([*words, "--out", str(out), "--reference", "12", "--halo", "0"]) == 0
        cutout = read_cutout(out)
        assert cutout.reference == 12
        for part, (name, picture) in zip(cutout.parts, PARTS.items(), strict=True):
            assert part.name == name
            inner = part.rgba[..., 3] == 255
            # Behind the part in front too: the colour is the part's own, filled in.
            assert (part.rgba[inner][:, :3] == picture[picture[..., 3] > 0][0, :3]).all()
            assert inner.sum() > 0.9 * (picture[..., 3] > 0).sum()
        assert run_command(["puppet", "check", str(out)]) == 0
    at = {joint.parts: joint.at for joint in read_cutout(tmp_path / "json").joints}
    assert at == {("body", "upper arm"): (105.0, 70.0), ("upper arm", "forearm"): None}


def test_an_out_folder_with_something_in_it_is_kept_and_an_empty_one_used(
    psd: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "puppet"
    out.mkdir()
    assert run_command(["puppet", "import", str(psd), "--out", str(out)]) == 0
    before = sorted(out.rglob("*"))
    for taken in (out, psd):
        assert run_command(["puppet", "import", str(psd), "--out", str(taken)]) == 2
    assert "is not empty; choose a new folder" in capsys.readouterr().err
    assert sorted(out.rglob("*")) == before


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.psd", b"8BPS broken", "not a Photoshop file"),
        ("a.kra", b"PK\x03\x04" + b"\0" * 26 + b"mimetypeapplication/x-krita", "save it as PSD or ORA"),
        ("a.zip", b"PK\x03\x04" + b"\0" * 60, "an archive; unpack it first"),
        ("a.png", b"\x89PNG\r\n\x1a\n", "one flat picture has no parts: outline them"),
        ("a.xcf", b"gimp xcf v011", "save it as PSD or ORA"),
        ("a.json", b'{"skeleton": {"spine": "4.2"}, "bones": []}', "a Spine skeleton; export its pictures"),
        ("a.json", b'{"hello": 1}', "expected LabelMe, COCO or a DragonBones skeleton"),
        ("a.svg", b'<?xml version="1.0"?><html/>', "not a format we read"),
        ("missing", None, "found nothing there"),
    ],
)
def test_what_is_no_puppet_is_refused_in_one_line_with_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, data: bytes | None, words: str
) -> None:
    if data is not None:
        (tmp_path / name).write_bytes(data)
    assert run_command(["puppet", "import", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not (tmp_path / "out").exists()


def test_a_forced_format_and_a_puppet_folder_are_told(
    psd: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["puppet", "import", str(psd), "--out", str(tmp_path / "out")]
    assert run_command([*words, "--from", "labelme"]) == 2
    assert run_command([*words, "--frame", str(psd)]) == 2
    assert "a psd holds its own pictures; leave --frame out" in capsys.readouterr().err
    assert run_command(words) == 0
    again = ["puppet", "import", str(tmp_path / "out"), "--out", str(tmp_path / "second")]
    assert run_command(again) == 2
    assert "is a puppet folder already" in capsys.readouterr().err


def test_a_missing_library_is_named_with_what_to_install(
    psd: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "psd_tools", None)
    assert run_command(["puppet", "import", str(psd), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs psd_tools; python -m pip install 'wildpuppet[import]'" in line


def test_the_table_of_formats_names_what_is_read(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["formats"]) == 0
    told = capsys.readouterr().out
    for name in ("psd", "ora", "png", "svg", "labelme", "coco", "animated-drawings", "dragonbones"):
        assert f"\n{name} " in told
