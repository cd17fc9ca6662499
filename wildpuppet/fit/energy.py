"""The terms of the energy, each a plain function of a batch of B frames that gives one number per frame.

Neural Puppet, sections 3.2 and 3.4:

    L = ||x R1 - R||^2 / sum(R1)  +  2500 L_reg  +  1e4 sum_i ||p_i - q_i||^2  +  2e-3 |sum R1 - sum R1_init|^2

x the frame, R the rendered puppet, R1 its mask (the puppet in white on black), p_i and q_i the two sides of hinge i.
L_reg is in ``wildpuppet.geometry.arap``. The printed weights balance in these units only: images 0..255 and *mean*
squared errors, vertices in [-1, 1] (``to_unit``) for L_reg and the hinges, areas in pixels. Rendered images are
(B, H, W, 4), premultiplied, 0..1, as the renderer gives them; alpha is R1.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

WHITE = 255.0
LEAST_MASK = 1.0
"""A mask smaller than this many pixels is taken to be this large: a puppet out of the picture costs a finite 0."""


def to_unit(points: Float[Tensor, "*batch 2"], size: tuple[int, int]) -> Float[Tensor, "*batch 2"]:
    """Map pixels of a (W, H) image to [-1, 1] along its larger side; the centre to 0. Angles are kept."""
    return (2.0 * points - points.new_tensor(size)) / max(size)


def from_unit(points: Float[Tensor, "*batch 2"], size: tuple[int, int]) -> Float[Tensor, "*batch 2"]:
    """Map back to pixels; the inverse of ``to_unit``."""
    return 0.5 * (max(size) * points + points.new_tensor(size))


def masked_reconstruction(target: Float[Tensor, "B H W 3"], rendered: Float[Tensor, "B H W 4"]) -> Float[Tensor, "B"]:
    """Compute ||x R1 - R||^2 / sum(R1): the mean squared difference under the mask, 0..255 squared.

    R1 is an RGB image, so its sum counts each pixel three times. Shrinking the mask to a part of the picture that
    it explains well lowers this term; an area term has to stand against it.
    """
    alpha = rendered[..., 3:]
    squares = ((target * alpha - WHITE * rendered[..., :3]) ** 2).sum((1, 2, 3))
    return squares / (3.0 * alpha.sum((1, 2, 3)).clamp_min(LEAST_MASK))


def reconstruction(
    target: Float[Tensor, "B H W 3"], rendered: Float[Tensor, "B H W 4"], background: Float[Tensor, "#B #H #W 3"]
) -> Float[Tensor, "B"]:
    """Compute ||x - R||^2 with the puppet over a known background (0..255), as a mean over pixels and channels."""
    shown = WHITE * rendered[..., :3] + (1.0 - rendered[..., 3:]) * background
    return ((target - shown) ** 2).mean((1, 2, 3))


def joint_points(
    vertices: Float[Tensor, "B V 2"], joint_vertices: Int[Tensor, "J 2 3"], joint_weights: Float[Tensor, "J 2 3"]
) -> Float[Tensor, "B J 2 2"]:
    """Find both points of each hinge; the axes are frame, hinge, side, (x, y)."""
    return (vertices[:, joint_vertices] * joint_weights[..., None]).sum(-2)


def joint_distance(
    vertices: Float[Tensor, "B V 2"],
    joint_vertices: Int[Tensor, "J 2 3"],
    joint_weights: Float[Tensor, "J 2 3"],
    slack: float = math.inf,
) -> Float[Tensor, "B"]:
    """Compute sum_i ||p_i - q_i||^2 in the squared units of the vertices; 0 without hinges.

    Beyond ``slack`` (in the units of the vertices; the paper has none) a gap costs linearly (Huber): a hinge that was
    guessed from an overlap may really open, and should not bend its parts for it.
    """
    sides = joint_points(vertices, joint_vertices, joint_weights)
    squares = ((sides[:, :, 0] - sides[:, :, 1]) ** 2).sum(-1)
    if math.isfinite(slack):
        gaps = squares.clamp_min(slack**2).sqrt()
        squares = torch.where(squares < slack**2, squares, slack * (2 * gaps - slack))
    return squares.sum(1)


def mask_area(alpha: Float[Tensor, "B H W"], initial: Float[Tensor, "#B H W"]) -> Float[Tensor, "B"]:
    """Compute |sum R1 - sum R1_init|^2, squared pixels, as printed.

    It also stands against a limb that rightly crosses the body and against a zoom; see ``layer_area``.
    """
    return (alpha.sum((1, 2)) - initial.sum((1, 2))) ** 2


def layer_area(
    vertices: Float[Tensor, "B V 2"],
    rest: Float[Tensor, "#B V 2"],
    triangles: Int[Tensor, "F 3"],
    layer_of_triangle: Int[Tensor, "F"],
) -> Float[Tensor, "B"]:
    """Compute the sum over layers of |area - area at rest|^2, squared pixels; blind to which layer hides which.

    ``rest`` is the puppet as it is expected in the frame, scale included. A triangle turned inside out counts as
    negative area, so folding is no way to shrink.
    """
    before, after = _twice_areas(rest, triangles), _twice_areas(vertices, triangles)
    changes = 0.5 * (after * before.sign() - before.abs())
    num_layers = int(layer_of_triangle.max()) + 1 if len(layer_of_triangle) else 0
    sums = torch.zeros(len(vertices), num_layers, dtype=vertices.dtype, device=vertices.device)
    return (sums.index_add(1, layer_of_triangle.long(), changes) ** 2).sum(1)


def _twice_areas(vertices: Float[Tensor, "B V 2"], triangles: Int[Tensor, "F 3"]) -> Float[Tensor, "B F"]:
    """Twice the signed area of each triangle."""
    corners = vertices[:, triangles]
    first, second = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
