from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.scene_values import crops_of, true_vertices
from tests.scenes import Scene, make_scene
from wildpuppet.deform import teach as teaching
from wildpuppet.deform.lesson import Lesson, lesson_of, taught_frames
from wildpuppet.deform.model import Model
from wildpuppet.deform.skeleton import SkeletonTensors, vertices_of
from wildpuppet.deform.teach import batch_of, in_window, moved, new_reader, teach
from wildpuppet.errors import InputError, StoreError
from wildpuppet.fit.energy import from_unit
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings, TrainSettings
from wildpuppet.types import Crops, Fit, Puppet

torch.set_num_threads(1)
HELD_OUT = np.array([3, 8])
PIXELS = 40
QUICK = TrainSettings(iterations=6, batch=8, learning_rate=1e-3, code=200, encoder_pixels=PIXELS, seed=4)


@pytest.fixture(scope="module")
def walk() -> Scene:
    return make_scene("crossing", frames=12, size=(96, 112), cycles=0.5, height=0.8)


@pytest.fixture(scope="module")
def doll(walk: Scene) -> Puppet:
    return build(walk.cutout, PuppetSettings(edge=0.2))


def true_fit(scene: Scene, puppet: Puppet) -> Fit:
    vertices = true_vertices(scene, puppet)
    frames = np.arange(len(vertices))
    return Fit(frames, vertices, scene.order, np.ones(vertices.shape[:2]), ("fitted",) * len(vertices))


def drawings_of(scene: Scene) -> Crops:
    """The frames as drawings: white paper behind them."""
    return replace(crops_of(scene), ordered=False, reference=None)


@pytest.fixture(scope="module")
def lesson(walk: Scene, doll: Puppet) -> Lesson:
    crops, fit = drawings_of(walk), true_fit(walk, doll)
    return lesson_of(doll, crops, fit, taught_frames(crops, fit, HELD_OUT), QUICK.code, PIXELS)


def interrupted(at: int) -> Callable[[int, int, dict[str, float]], None]:
    def tell(done: int, total: int, losses: dict[str, float]) -> None:
        if done == at:
            raise KeyboardInterrupt

    return tell


def test_held_out_drawings_are_not_taught(doll: Puppet):
    twos = make_scene("twos", frames=12, size=(112, 84))
    crops, fit = crops_of(twos), true_fit(twos, doll)
    shown = {int(drawing): int(np.flatnonzero(crops.drawing == drawing)[0]) for drawing in crops.drawing}
    hidden = crops.drawing[5]
    rows = taught_frames(crops, fit, np.array([5]))
    assert set(rows.tolist()) == {row for drawing, row in shown.items() if drawing != hidden}
    with pytest.raises(InputError, match="found none"):
        lesson_of(doll, crops, fit, taught_frames(crops, fit, crops.frames), 8, 16)


def test_the_code_is_white_over_the_fits_and_goes_both_ways(lesson: Lesson, doll: Puppet):
    poses = lesson.known.poses
    codes = lesson.code.codes(poses)
    assert codes.min() < -0.5 < 0.5 < codes.max()
    np.testing.assert_allclose(codes.mean(0), 0.0, atol=1e-9)
    assert codes.std(0).max() <= 1.0 + 1e-9
    again = lesson.code.mean + codes @ lesson.code.directions
    skeleton = SkeletonTensors(lesson.skeleton)
    truth, back = (vertices_of(skeleton, torch.from_numpy(each).float()).numpy() for each in (poses, again))
    assert np.abs(truth - back).max() < 1e-4
    assert np.abs(truth - lesson.truth).max() < 1e-3


def test_made_up_pictures_show_the_puppet_where_the_vertices_say(lesson: Lesson, doll: Puppet):
    """There is no white paper where two parts meet; the codes given are those of the vertices."""
    network, random = new_reader(lesson, 0), np.random.default_rng(0)
    pictures, vertices, trust, codes = batch_of(lesson, network, 16, random)
    assert pictures.shape == (16, 3, PIXELS, PIXELS)
    assert trust.shape == vertices.shape[:2]
    torch.testing.assert_close(network.decode(codes), vertices[: len(codes)], atol=1e-3, rtol=0.0)
    darkness = 1.0 - pictures[:, None].amin(2)
    hinges = (vertices[:, doll.joint_vertices] * torch.from_numpy(doll.joint_weights).float()[..., None]).sum(-2)
    places = hinges.mean(2)[:, :, None]
    at_parts = torch.nn.functional.grid_sample(darkness, places, align_corners=False)
    anywhere = torch.nn.functional.grid_sample(darkness, places.roll(1, 0), align_corners=False)
    assert at_parts.mean() > 1.15 * anywhere.mean(), (at_parts.mean(), anywhere.mean())
    assert at_parts.mean() > 0.35


def test_real_pictures_move_with_their_vertices(lesson: Lesson):
    """White paper with one dark dot at a vertex: the dot stays at the vertex."""
    height, width = lesson.real.shape[1:3]
    unit, size = np.array([0.31, -0.2]), np.array(lesson.size)
    place = 0.5 * (max(lesson.size) * unit + size) * (np.array([width, height]) / size)
    y, x = np.mgrid[:height, :width] + 0.5
    dot = 255 - 200 * np.exp(-((x - place[0]) ** 2 + (y - place[1]) ** 2) / (2 * 2.5**2))
    real = np.repeat(np.repeat(dot[None, ..., None], 3, 3), len(lesson.real), 0).astype(np.uint8)
    truth = np.broadcast_to(unit, lesson.truth.shape).copy()
    dotted = Lesson(**{**vars(lesson), "real": real, "truth": truth})
    for seed in range(4):
        picture, vertices = moved(dotted, 0, np.random.default_rng(seed))
        dark = np.maximum(200.0 - picture.mean(-1), 0.0)
        rows, columns = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
        found = np.array([(dark * columns).sum(), (dark * rows).sum()]) / dark.sum()
        np.testing.assert_allclose(found, in_window(lesson, vertices[:1][None])[0, 0], atol=0.3)


def test_held_out_drawings_are_read_better_than_copying_the_nearest(walk, doll, lesson):
    """The baseline knows which taught drawing is truly nearest to each one that was never seen."""
    settings = TrainSettings(iterations=200, batch=16, learning_rate=2e-3, code=200, encoder_pixels=PIXELS, seed=0)
    network, losses = teach(lesson, settings)
    assert losses["vertices"][-20:].mean() < 0.25 * losses["vertices"][:5].mean()
    crops, truth = drawings_of(walk), true_vertices(walk, doll)
    model = Model(doll, crops.size, network, settings, "ours", is_on_paper=True)
    read = model.decode(model.encode(crops.images[HELD_OUT]))
    found = np.linalg.norm(read - truth[HELD_OUT], axis=-1).mean()
    taught = np.delete(truth, HELD_OUT, 0)
    nearest = np.linalg.norm(truth[HELD_OUT][:, None] - taught[None], axis=-1).mean(-1).min(1).mean()
    standing = np.linalg.norm(taught.mean(0) - truth[HELD_OUT], axis=-1).mean()
    assert found < 0.65 * min(nearest, standing), (found, nearest, standing)
    codes = model.codes_of(truth[HELD_OUT])
    assert np.linalg.norm(model.decode(codes) - truth[HELD_OUT], axis=-1).max() < 0.2 * nearest


def test_gradients_reach_the_codes(lesson: Lesson, doll: Puppet):
    model = Model(doll, lesson.size, new_reader(lesson, 0).eval(), QUICK, "ours")
    count = len(lesson.code.directions)
    codes = torch.zeros(1, count, requires_grad=True)
    place = model.decode_tensor(codes)[0, 5, 0]
    (gradient,) = torch.autograd.grad(place, codes)
    step = np.eye(count)[2:3]
    ahead, behind = (model.decode(0.05 * sign * step)[0, 5, 0] for sign in (1.0, -1.0))
    assert abs((ahead - behind) / 0.1 - gradient[0, 2].item()) < 0.01 * max(1.0, abs(gradient[0, 2].item()))
    np.testing.assert_allclose(
        model.decode(np.zeros((1, count))), from_unit(model.network.decode(codes), lesson.size).detach().numpy()
    )


def test_a_killed_training_ends_where_an_unbroken_one_does(lesson: Lesson, tmp_path, monkeypatch):
    monkeypatch.setattr(teaching, "CHECKPOINT_SECONDS", 0.0)
    unbroken, losses = teach(lesson, QUICK)
    path = tmp_path / "work" / "training.safetensors"
    for stop in (2, 5):
        with pytest.raises(KeyboardInterrupt):
            teach(lesson, QUICK, path, interrupted(stop))
    broken, again = teach(lesson, QUICK, path)
    for (name, weights), other in zip(unbroken.state_dict().items(), broken.state_dict().values(), strict=True):
        assert torch.equal(weights, other), name
    for name in losses:
        np.testing.assert_array_equal(losses[name], again[name])
    with pytest.raises(StoreError, match="delete it to start anew"):
        teach(lesson, TrainSettings(**{**{f: getattr(QUICK, f) for f in QUICK.__struct_fields__}, "seed": 5}), path)
