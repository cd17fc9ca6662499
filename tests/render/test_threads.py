"""Frames over threads: the same numbers whatever the number of threads, errors come through, forks are safe."""

import os
from collections.abc import Iterator

import pytest
import torch

from tests.render.scenes import grid_puppet
from wildpuppet.render import threads
from wildpuppet.render.render import Texture, render


@pytest.fixture(autouse=True)
def _restore_threads() -> Iterator[None]:
    before = threads._Pool.num_threads
    yield
    threads.use_threads(before)


def _gradients(num_threads: int) -> list[torch.Tensor]:
    threads.use_threads(num_threads)
    vertices, mesh, texture, order = grid_puppet(4, 5, 32, seed=2)
    leaves = [vertices.requires_grad_(), texture.rgba.requires_grad_()]
    rgba = render(leaves[0], mesh, Texture(leaves[1], texture.uv), order, (32, 32)).rgba
    return [rgba.detach(), *torch.autograd.grad(rgba.square().sum(), leaves)]


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    for one, three in zip(_gradients(1), _gradients(3), strict=True):
        assert torch.equal(one, three)


def test_errors_reach_the_caller() -> None:
    def work(index: int, first: int, end: int) -> None:
        raise RuntimeError(f"run {index}")

    threads.use_threads(2)
    with pytest.raises(RuntimeError, match="run 0"):
        threads.run_shares(work, threads.shares(4))
    with pytest.raises(ValueError, match="at least 1"):
        threads.use_threads(0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_child_makes_its_own_threads() -> None:
    threads.use_threads(2)
    done: list[int] = []
    threads.run_shares(lambda index, first, end: done.append(index), threads.shares(4))
    child = os.fork()
    if child == 0:
        threads.run_shares(lambda index, first, end: done.append(index), threads.shares(4))
        os._exit(0 if len(done) == 4 else 1)
    assert os.waitpid(child, 0)[1] == 0
