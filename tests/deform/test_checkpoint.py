from collections.abc import Callable

import numpy as np
import pytest

from tests.scene_values import crops_of, true_poses
from tests.scenes import make_scene
from wildpuppet.deform import learn as learning
from wildpuppet.deform.learn import learn, predict
from wildpuppet.errors import InputError, StoreError
from wildpuppet.machine import Machine
from wildpuppet.settings import FitSettings, TrainSettings
from wildpuppet.types import Crops


def interrupted(at: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done == at:
            raise KeyboardInterrupt

    return progress


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> TrainSettings:
    monkeypatch.setattr(learning, "CHECKPOINT_SECONDS", 0.0)
    return TrainSettings(iterations=6, batch=3, encoder_pixels=16, distil=0.3, seed=5)


def test_killed_training_ends_where_an_unbroken_one_does(scene, puppet, short, fit_settings, tmp_path):
    crops = crops_of(scene)
    unbroken = learn(puppet, crops, true_poses(scene), short, fit_settings, Machine("cpu"))
    path = tmp_path / "work" / "training.safetensors"
    for stop in (1, 4):
        with pytest.raises(KeyboardInterrupt):
            learn(
                puppet, crops, true_poses(scene), short, fit_settings, Machine("cpu", progress=interrupted(stop)), path
            )
    broken = learn(puppet, crops, true_poses(scene), short, fit_settings, Machine("cpu"), path)
    assert unbroken.weights.keys() == broken.weights.keys()
    for name, weights in unbroken.weights.items():
        np.testing.assert_array_equal(weights, broken.weights[name], err_msg=name)
    for name, losses in unbroken.losses.items():
        np.testing.assert_array_equal(losses, broken.losses[name], err_msg=name)


def test_a_checkpoint_of_another_training_or_a_damaged_one_is_refused(scene, puppet, short, fit_settings, tmp_path):
    crops, path = crops_of(scene), tmp_path / "training.safetensors"
    with pytest.raises(KeyboardInterrupt):
        learn(puppet, crops, true_poses(scene), short, fit_settings, Machine("cpu", progress=interrupted(2)), path)
    with pytest.raises(StoreError, match="delete it to start anew"):
        learn(puppet, crops, true_poses(scene), short, FitSettings(arap=1.0), Machine("cpu"), path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(StoreError, match="not a whole checkpoint"):
        learn(puppet, crops, true_poses(scene), short, fit_settings, Machine("cpu"), path)


def test_held_drawings_get_exactly_the_same_and_lost_frames_teach_nothing(puppet, short, fit_settings):
    twos = make_scene("twos", frames=4, size=(112, 84))
    crops = crops_of(twos)
    trained = learn(puppet, crops, true_poses(twos), short, fit_settings, Machine("cpu"))
    vertices = predict(crops, trained, short, Machine("cpu"))
    np.testing.assert_array_equal(vertices[0], vertices[1])
    assert (vertices[1] != vertices[2]).any()
    lost = Crops(**{**vars(crops), "state": ("lost",) * 4})
    with pytest.raises(InputError, match="lost in all"):
        learn(puppet, lost, true_poses(twos), short, fit_settings, Machine("cpu"))
