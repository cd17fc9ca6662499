"""The data term of the descent: what the picture says of a rendered puppet, in one pass over the pixels each way.

With a the puppet's coverage of a pixel, R its premultiplied colour and x the frame's (Neural Puppet, section 3.4, made
robust): s = ||x a - R||^2 / 3 costs rho(s) = s / (1 + s / limit) (Geman and McClure), and covering or leaving a pixel
costs max(gain, 0) - gain a. Where a hundred pixels are wrong by a changed face they count no more than very wrong.
"""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from wildpuppet.fit.data_kernel import add_prices, add_slopes
from wildpuppet.render.threads import run_shares, shares


def data_term(
    rendered: Float[Tensor, "B H W 4"],
    colour: Float[Tensor, "B H W 3"],
    gain: Float[Tensor, "B H W"],
    limit: float,
) -> tuple[Float[Tensor, "B"], Float[Tensor, "B"]]:
    """Sum rho and the price of covering over each frame, in squared grey levels; differentiable in ``rendered``.

    ``rendered`` is 0..1 and premultiplied, ``colour`` 0..255, ``gain`` and ``limit`` squared grey levels. float32 on
    the CPU; raises TypeError for anything else.
    """
    if any(image.dtype != torch.float32 or image.device.type != "cpu" for image in (rendered, colour, gain)):
        raise TypeError(f"the data term takes float32 on the CPU, not {rendered.dtype} on {rendered.device}")
    sums: tuple[Tensor, Tensor] = _DataTerm.apply(rendered, colour, gain, limit)  # type: ignore[no-untyped-call]
    return sums


class _DataTerm(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rendered: Tensor, colour: Tensor, gain: Tensor, limit: float) -> tuple[Tensor, Tensor]:
        robust, coverage = rendered.new_zeros(len(rendered)), rendered.new_zeros(len(rendered))
        images, sums = _flat(rendered, colour, gain), (robust.numpy(), coverage.numpy())
        run_shares(
            lambda _, first, end: add_prices(first, end, *images, np.float32(limit), *sums), shares(len(rendered))
        )
        ctx.save_for_backward(rendered, colour, gain)
        ctx.limit = limit
        return robust, coverage

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, to_robust: Tensor, to_coverage: Tensor) -> tuple[Tensor, None, None, None]:
        rendered, colour, gain = ctx.saved_tensors
        gradient = torch.empty_like(rendered)
        images, slopes = _flat(rendered, colour, gain), gradient.reshape(len(gradient), -1).numpy()
        given = (to_robust.contiguous().numpy(), to_coverage.contiguous().numpy())
        run_shares(
            lambda _, first, end: add_slopes(first, end, *images, np.float32(ctx.limit), *given, slopes),
            shares(len(rendered)),
        )
        return gradient, None, None, None


def _flat(*images: Tensor) -> tuple[Float[np.ndarray, "B _"], ...]:
    return tuple(image.detach().contiguous().reshape(len(image), -1).numpy() for image in images)
