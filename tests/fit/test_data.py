import numpy as np
import pytest
import torch

from wildpuppet.fit.data import data_term

SHAPE = (3, 5, 7)
"""Frames, rows, columns."""


@pytest.fixture
def images() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Premultiplied RGBA, colours, and gains of both signs; some pixels are not covered at all."""
    draw = np.random.default_rng(0)
    alpha = draw.uniform(0, 1, (*SHAPE, 1)) * (draw.uniform(0, 1, (*SHAPE, 1)) > 0.3)
    rendered = np.concatenate([alpha * draw.uniform(0, 1, (*SHAPE, 3)), alpha], -1)
    arrays = rendered, draw.uniform(0, 255, (*SHAPE, 3)), draw.uniform(-800, 800, SHAPE)
    return tuple(torch.from_numpy(array.astype(np.float32)) for array in arrays)


def as_written(rendered, colour, gain, limit):
    alpha = rendered[..., 3]
    squares = ((colour * alpha[..., None] - 255 * rendered[..., :3]) ** 2).sum(-1) / 3
    robust = squares / (1 + squares / limit)
    return robust.sum((1, 2)), (gain.clamp_min(0) - gain * alpha).sum((1, 2))


@pytest.mark.parametrize("limit", [100.0, 1600.0, 1e6])
def test_sums_and_gradient_are_those_of_the_formula(images, limit):
    rendered, colour, gain = images
    shares = torch.tensor([[1.0, 0.5, -2.0], [0.3, 4.0, 1.0]])
    results = []
    for term in (data_term, as_written):
        moving = rendered.clone().requires_grad_()
        sums = torch.stack(term(moving, colour, gain, limit))
        (gradient,) = torch.autograd.grad((shares * sums).sum(), moving)
        results.append((sums.detach(), gradient))
    torch.testing.assert_close(results[0][0], results[1][0], rtol=1e-5, atol=1e-2)
    torch.testing.assert_close(results[0][1], results[1][1], rtol=1e-4, atol=1e-2)


def test_other_numbers_are_refused(images):
    rendered, colour, gain = images
    with pytest.raises(TypeError, match="float32 on the CPU"):
        data_term(rendered.double(), colour, gain, 100.0)
