from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.refine.shaded import NUM_DRAWINGS, SIDE, shaded
from wildpuppet.errors import InputError, SettingsError, StoreError
from wildpuppet.machine import Machine
from wildpuppet.refine.examples import usable_frames
from wildpuppet.refine.refiner import Refiner, refine_pictures, refiner_of
from wildpuppet.refine.texture import on_white
from wildpuppet.refiners import load_refiner, save_refiner
from wildpuppet.settings import RefineSettings

HELD_OUT = (3, 8, 12)
TINY = RefineSettings(iterations=60, batch=4, patch=32, width=8, depth=2, critic_steps=0, learning_rate=3e-3)
WITH_CRITIC = RefineSettings(iterations=8, batch=2, patch=32, width=4, depth=2, critic_steps=2)


class StopError(Exception):
    """Stands for a kill."""


def learnt(settings: RefineSettings, machine: Machine | None = None, checkpoint: Path | None = None) -> Refiner:
    scene = shaded()
    machine = machine or Machine(device="cpu")
    return refiner_of(scene.puppet, scene.crops, scene.fit, settings, machine, HELD_OUT, checkpoint)


def drawn(index: int) -> np.ndarray:
    """A drawing over white, 0..255."""
    rgba = np.asarray(shaded().crops.images[index : index + 1][0]).astype(np.float64)
    alpha = rgba[..., 3:] / 255.0
    return rgba[..., :3] * alpha + 255.0 * (1.0 - alpha)


def error(refiner: Refiner) -> float:
    """Mean squared error on the drawings held out."""
    fit = shaded().fit
    pictures = refine_pictures(refiner, fit.vertices_crop[list(HELD_OUT)], fit.order[list(HELD_OUT)])
    return float(
        np.mean([((255.0 * on_white(p) - drawn(i)) ** 2).mean() for i, p in zip(HELD_OUT, pictures, strict=True)])
    )


def rendered_error(refiner: Refiner) -> float:
    fit, figure = shaded().fit, refiner.wardrobe.figure
    pictures = [figure.draw(fit.vertices_crop[i], fit.order[i]).rgba for i in HELD_OUT]
    return float(
        np.mean([((255.0 * on_white(p) - drawn(i)) ** 2).mean() for i, p in zip(HELD_OUT, pictures, strict=True)])
    )


@pytest.fixture(scope="module")
def both() -> Refiner:
    return learnt(TINY)


def test_drawings_held_out_are_nearer_than_the_rendered_puppet(both: Refiner) -> None:
    texture = replace(both, settings=RefineSettings(method="texture"), generator=None)
    rendered, by_texture, by_both = rendered_error(both), error(texture), error(both)
    assert not set(HELD_OUT) & set(both.examples.frames.tolist())
    assert by_texture < 0.25 * rendered
    assert by_both < 1.02 * by_texture
    paper = learnt(msgspec.structs.replace(TINY, method="network"))
    assert error(paper) < 0.9 * rendered


def test_pictures_have_a_sane_alpha(both: Refiner) -> None:
    fit = shaded().fit
    for t, picture in enumerate(refine_pictures(both, fit.vertices_crop, fit.order)):
        assert picture.shape == (SIDE, SIDE, 4)
        assert picture.min() >= 0.0
        assert picture.max() <= 1.0
        assert (picture[..., :3] <= picture[..., 3:] + 1e-6).all()
        true = np.asarray(shaded().crops.images[t : t + 1][0])[..., 3] / 255.0
        assert np.abs(picture[..., 3] - true).mean() < 0.02


def test_where_the_crop_lies_in_the_picture_does_not_matter(both: Refiner) -> None:
    fit = shaded().fit
    here = next(refine_pictures(both, fit.vertices_crop[5:6], fit.order[5:6]))
    shift = np.array([[[1.0, 0.0, 40.0], [0.0, 1.0, 7.0]]])
    far = shift + np.array([[[0.0, 0.0, 400.0], [0.0, 0.0, 0.0]]])
    moved = next(refine_pictures(both, fit.vertices_crop[5:6] - (400.0, 0.0), fit.order[5:6], (200, 120), far))
    assert np.abs(moved[7 : 7 + SIDE, 40 : 40 + SIDE] - here).max() < 1e-4
    twice = (2 * SIDE, 2 * SIDE), 2.0 * np.eye(2, 3)[None]
    large = next(refine_pictures(both, fit.vertices_crop[5:6], fit.order[5:6], *twice))
    averaged = large.reshape(SIDE, 2, SIDE, 2, 4).mean((1, 3))
    assert np.abs(averaged - here).mean() < 0.01


def test_a_seed_gives_the_same_bits_and_a_killed_training_goes_on_to_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = learnt(WITH_CRITIC)
    assert (whole.losses["slope"] > 0.0).all()

    def stop(done: int, total: int) -> None:
        if done == 5:
            raise StopError

    monkeypatch.setattr("wildpuppet.refine.learn.CHECKPOINT_SECONDS", 0.0)
    checkpoint = tmp_path / "training.safetensors"
    with pytest.raises(StopError):
        learnt(WITH_CRITIC, Machine(device="cpu", progress=stop), checkpoint)
    steps: list[int] = []
    resumed = learnt(WITH_CRITIC, Machine(device="cpu", progress=lambda done, _: steps.append(done)), checkpoint)
    assert min(steps) >= 4
    assert whole.generator is not None
    assert resumed.generator is not None
    for name, tensor in whole.generator.state_dict().items():
        assert (tensor == resumed.generator.state_dict()[name]).all(), name
    assert whole.share == resumed.share
    with pytest.raises(StoreError, match="another"):
        learnt(msgspec.structs.replace(WITH_CRITIC, batch=3), checkpoint=checkpoint)


def test_a_refiner_is_kept_and_refuses_another_puppet(both: Refiner, tmp_path: Path) -> None:
    save_refiner(tmp_path / "first", both)
    save_refiner(tmp_path / "second", both)
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes(), path.name
    again = load_refiner(tmp_path / "first", shaded().puppet)
    assert again.hold_out == HELD_OUT
    assert error(again) == error(both)
    other = replace(shaded().puppet, names=("body", "wing"))
    with pytest.raises(InputError, match="another puppet"):
        load_refiner(tmp_path / "first", other)
    with pytest.raises(InputError, match="another puppet"):
        both.refine(shaded().fit.vertices_crop[0][:-1], shaded().fit.order[0])
    with pytest.raises(InputError, match=r"refiner\.json"):
        load_refiner(tmp_path, shaded().puppet)


def test_what_can_be_learnt_from_is_told() -> None:
    scene = shaded()
    with pytest.raises(InputError, match="99"):
        usable_frames(scene.crops, scene.fit, [99])
    with pytest.raises(InputError, match="at least 2"):
        usable_frames(scene.crops, scene.fit, range(NUM_DRAWINGS - 1))
    held = replace(scene.crops, drawing=np.arange(NUM_DRAWINGS) // 2)
    assert usable_frames(held, scene.fit, [4]).tolist() == [0, 2, 6, 8, 10, 12, 14]
    with pytest.raises(SettingsError, match="multiple of 16"):
        learnt(RefineSettings(patch=40))
