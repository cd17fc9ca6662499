import os

import numpy as np
import pytest

from wildpuppet.errors import StoreError
from wildpuppet.video.lossless import VideoImages, write_lossless


@pytest.fixture(scope="module")
def images():
    generator = np.random.default_rng(4)
    images = generator.integers(0, 256, (40, 37, 53, 4), np.uint8)
    images[:, 5:20, :, 3] = 0
    return images


def test_round_trip_is_exact_in_any_order(tmp_path, images):
    write_lossless(tmp_path / "images.mkv", images)
    stored = VideoImages(tmp_path / "images.mkv")
    assert len(stored) == 40
    for index in [
        slice(None),
        slice(30, 33),
        slice(3, 9, 2),
        slice(39, None),
        slice(0, 5),
        slice(7, 7),
        slice(9, 2, -3),
    ]:
        assert np.array_equal(stored[index], images[index])
        assert stored[index].dtype == np.uint8
        assert stored[index].shape == images[index].shape
    assert np.array_equal(np.stack(list(stored)), images)


def test_same_bytes_from_arrays_iterables_and_stored_images(tmp_path, images):
    write_lossless(tmp_path / "a.mkv", images)
    write_lossless(tmp_path / "b.mkv", (image for image in images))
    write_lossless(tmp_path / "c.mkv", VideoImages(tmp_path / "a.mkv"))
    first = (tmp_path / "a.mkv").read_bytes()
    assert first == (tmp_path / "b.mkv").read_bytes() == (tmp_path / "c.mkv").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mkv", "b.mkv", "c.mkv"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_reads_too(tmp_path, images):
    write_lossless(tmp_path / "images.mkv", images)
    stored = VideoImages(tmp_path / "images.mkv")
    assert np.array_equal(stored[3:5], images[3:5])
    child = os.fork()
    if child == 0:
        os._exit(0 if np.array_equal(stored[5:20], images[5:20]) else 1)
    assert np.array_equal(stored[5:20], images[5:20])
    assert os.waitpid(child, 0)[1] == 0


def test_failures_leave_nothing_behind(tmp_path, images):
    with pytest.raises(ValueError, match="expected uint8"):
        write_lossless(tmp_path / "images.mkv", iter([images[0], images[1][:5]]))
    with pytest.raises(ValueError, match="at least one"):
        write_lossless(tmp_path / "images.mkv", images[:0])
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "broken.mkv").write_bytes(b"broken")
    with pytest.raises(StoreError, match=r"broken\.mkv"):
        len(VideoImages(tmp_path / "broken.mkv"))
