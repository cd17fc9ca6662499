import numpy as np
import pytest
from PIL import Image, ImageDraw

from wildpuppet.errors import InputError
from wildpuppet.video.backdrop import TOLERANCE
from wildpuppet.video.drawings import read_drawing, read_drawings

SIZE = 240
FILL = (230, 140, 60)
OVERSAMPLED = 8
ALPHA_TOLERANCE = TOLERANCE / (255 - min(FILL)) + 0.01
"""Of the true coverage: fainter mixtures count as backdrop; and rounding."""


def true_coverage():
    """A ring (a gap inside near the outside) with an outlined disc deep in a large body, drawn eight times larger."""
    large = Image.new("L", (SIZE * OVERSAMPLED, SIZE * OVERSAMPLED), 0)
    draw = ImageDraw.Draw(large)
    draw.ellipse([v * OVERSAMPLED for v in (20, 60, 150, 190)], fill=255)
    draw.ellipse([v * OVERSAMPLED for v in (140, 90, 220, 170)], fill=255)
    draw.ellipse([v * OVERSAMPLED for v in (149, 99, 211, 161)], fill=0)
    return np.asarray(large.reduce(OVERSAMPLED), np.float64) / 255.0


@pytest.fixture
def drawing():
    coverage = true_coverage()[..., None]
    picture = np.rint(coverage * FILL + (1 - coverage) * 255).astype(np.uint8)
    image = Image.fromarray(picture)
    ImageDraw.Draw(image).ellipse((75, 115, 95, 135), fill=(255, 255, 255))
    return image


@pytest.mark.parametrize("suffix", ["png", "webp", "jpg"])
def test_matte_of_a_drawing_on_white(tmp_path, drawing, suffix):
    options = {"png": {}, "webp": {"lossless": True}, "jpg": {"quality": 95, "subsampling": 0}}[suffix]
    drawing.save(tmp_path / f"drawing.{suffix}", **options)
    rgba = read_drawing(tmp_path / f"drawing.{suffix}")
    alpha, truth = rgba[..., 3] / 255.0, true_coverage()
    tolerance = ALPHA_TOLERANCE if suffix != "jpg" else 3 * ALPHA_TOLERANCE
    assert np.abs(alpha - truth).max() < tolerance
    assert alpha[130, 180] == 0.0, "the gap in the ring is not the character"
    assert alpha[125, 85] == 1.0, "the eye is"
    partial = (alpha > 0.3) & (alpha < 1)
    assert np.abs(rgba[partial][:, :3].astype(int) - FILL).max() <= (2 if suffix != "jpg" else 40)


def test_transparency_is_kept_and_other_backdrops_are_all_character(tmp_path):
    generator = np.random.default_rng(5)
    given = generator.integers(0, 256, (20, 30, 4), np.uint8)
    Image.fromarray(given).save(tmp_path / "clear.png")
    assert np.array_equal(read_drawing(tmp_path / "clear.png"), given)
    Image.fromarray(given[..., :3]).save(tmp_path / "busy.png")
    busy = read_drawing(tmp_path / "busy.png")
    assert np.array_equal(busy[..., :3], given[..., :3])
    assert busy[..., 3].min() == 255
    Image.fromarray(np.full((9, 9, 3), 255, np.uint8)).save(tmp_path / "blank.png")
    assert read_drawing(tmp_path / "blank.png")[..., 3].max() == 0


def test_natural_order_and_slices(tmp_path):
    for number in (10, 9, 1, 100):
        Image.new("RGBA", (6, 4), (number, 0, 0, 128)).save(tmp_path / f"walk {number}.png")
    (tmp_path / "notes.txt").write_text("not a drawing")
    (tmp_path / ".hidden.png").write_text("not a drawing")
    names, images = read_drawings(tmp_path)
    assert names == ("walk 1.png", "walk 9.png", "walk 10.png", "walk 100.png")
    assert images.size == (6, 4)
    assert images[1:3][:, 0, 0, 0].tolist() == [9, 10]
    assert images[:0].shape == (0, 4, 6, 4)
    assert [int(image[0, 0, 0]) for image in images] == [1, 9, 10, 100]


def test_sixteen_bits_and_turned_photographs(tmp_path):
    grey = np.linspace(0, 65535, 12).reshape(3, 4).astype(np.uint16)
    Image.fromarray(grey).save(tmp_path / "deep.png")
    assert np.abs(read_drawing(tmp_path / "deep.png")[..., 0] - grey / 257.0).max() <= 0.5
    turned = Image.new("RGB", (6, 4), (9, 9, 9))
    exif = turned.getexif()
    exif[0x0112] = 6
    turned.save(tmp_path / "turned.jpg", exif=exif)
    assert read_drawing(tmp_path / "turned.jpg").shape == (6, 4, 4)


def test_mistakes_are_one_clear_line(tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    for folder, expected in [(tmp_path / "nowhere", "found nothing there"), (empty, "found none")]:
        with pytest.raises(InputError, match=expected):
            read_drawings(folder)
    for number, size in enumerate([(6, 4), (6, 4), (5, 4)]):
        Image.new("RGB", size).save(empty / f"{number}.png")
    with pytest.raises(InputError, match=r"2\.png: expected 6x4 pixels as in 2 of 3 drawings, found 5x4"):
        read_drawings(empty)
    (empty / "2.png").write_bytes(b"not a picture")
    with pytest.raises(InputError, match=r"2\.png: expected a picture") as caught:
        read_drawings(empty)
    assert "\n" not in str(caught.value)
