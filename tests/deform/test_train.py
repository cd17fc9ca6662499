import numpy as np
import torch

from tests.scene_values import crops_of, standing_poses, true_poses, true_vertices
from tests.scenes import Scene
from wildpuppet.deform.learn import learn, predict
from wildpuppet.deform.objective import TERMS, closest_similar, objective_of, scales_of
from wildpuppet.deform.train import train
from wildpuppet.fit.energy import to_unit
from wildpuppet.machine import Machine
from wildpuppet.pose.place import pose_vertices
from wildpuppet.settings import TrainSettings
from wildpuppet.types import Puppet


def error(vertices: np.ndarray, scene: Scene, puppet: Puppet) -> float:
    return float(np.linalg.norm(vertices - true_vertices(scene, puppet), axis=-1).mean())


def test_the_papers_losses_alone_bring_the_puppet_closer(scene, puppet, fit_settings):
    crops, poses = crops_of(scene), standing_poses(scene)
    settings = TrainSettings(
        iterations=80, learning_rate=2e-4, encoder_pixels=16, distil=0.0, as_printed=True, code_relu=True
    )
    trained = learn(puppet, crops, poses, settings, fit_settings, Machine("cpu"))
    total = sum(getattr(fit_settings, name) * trained.losses[name] for name in TERMS)
    assert total[-5:].mean() < 0.6 * total[0]
    rest = pose_vertices(puppet, poses.crop_from_canvas)
    assert error(predict(crops, trained, settings, Machine("cpu")), scene, puppet) < 0.9 * error(rest, scene, puppet)


def test_the_poses_of_a_search_are_learned(scene, puppet, fit_settings):
    crops, poses = crops_of(scene), true_poses(scene)
    standing = closest_similar(puppet.vertices, true_vertices(scene, puppet)[0])
    settings = TrainSettings(iterations=80, encoder_pixels=16, distil=0.4)
    fit = train(puppet, crops, poses, settings, fit_settings, Machine("cpu"))
    assert error(fit.vertices_crop, scene, puppet) < 0.5 * error(standing[None], scene, puppet)
    assert fit.confidence.shape == fit.vertices_crop.shape[:2]
    assert set(fit.losses) == set(TERMS)
    assert fit.state == ("fitted",) * 4


def test_the_truth_costs_least(scene, puppet):
    crops, poses = crops_of(scene), true_poses(scene)
    truth = to_unit(torch.from_numpy(true_vertices(scene, puppet)).float(), crops.size)
    frames, order = torch.from_numpy(scene.frames).float(), torch.from_numpy(scene.order)
    objective = objective_of(puppet, crops, poses, False, torch.device("cpu"))
    at_truth = objective.terms(truth, frames, order, torch.from_numpy(scales_of(poses)).float())
    shifted = objective.terms(truth + 0.03, frames, order, torch.from_numpy(scales_of(poses)).float())
    assert (at_truth["reconstruction"] < 0.5 * shifted["reconstruction"]).all()
    for name in ("arap", "joints", "area"):
        assert at_truth[name].max() < 1e-6
