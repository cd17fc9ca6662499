"""The losses of the appearance refinement (Neural Puppet, section 3.3): WGAN-GP with an L1 term.

    L_G = -E[D(G(x_rend))] + g1 ||G(x_rend) - x||_1
    L_D = E[D(G(x_rend))] - E[D(x)] + g2 E[(||grad D(x_hat)||_2 - 1)^2],   x_hat = e G + (1 - e) x

Pictures are 0..1 in the arrays and -1..1 here, as pix2pix has them: over white, with alpha as a fourth channel. Ours
adds a squared term: the L1 term's best answer is the median, which for lines that are a pixel off is no change at all.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

LEAST_NORM = 1e-12


def as_seen(premultiplied: Float[Tensor, "B 4 H W"]) -> Float[Tensor, "B 4 H W"]:
    """Lay pictures over white and bring them to -1..1; alpha is the fourth channel."""
    alpha = premultiplied[:, 3:]
    return 2.0 * torch.cat([premultiplied[:, :3] + 1.0 - alpha, alpha], 1) - 1.0


def penalty(
    critic: nn.Module, made: Float[Tensor, "B 4 H W"], drawn: Float[Tensor, "B 4 H W"], share: Float[Tensor, "B 1 1 1"]
) -> Float[Tensor, ""]:
    """Say how far the critic's slope is from 1 between made and drawn pictures; ``share`` is e."""
    between = (share * made + (1.0 - share) * drawn).detach().requires_grad_(True)
    slope = torch.autograd.grad(critic(between).sum(), between, create_graph=True)[0]
    norm = torch.sqrt((slope**2).sum((1, 2, 3)) + LEAST_NORM)
    return torch.as_tensor(((norm - 1.0) ** 2).mean())
