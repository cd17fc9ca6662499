"""R(V, F, texture): the public face of the renderer.

An image is continuous in the vertices when the texture's alpha is 0 along every mesh border (``texture_at`` sees to
it): the gradient is then the exact derivative of bilinear sampling, silhouettes included, and the usual mistake is a
texture without that margin, whose gradient misses the silhouettes in silence.
"""

from typing import Literal, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from wildpuppet.render.cpu import composite_cpu, scene_of
from wildpuppet.render.mesh import Mesh, mesh_of
from wildpuppet.render.reference import composite_reference
from wildpuppet.render.texture import Texture, texture_at

__all__ = ["Backend", "Mesh", "Rendering", "Texture", "mesh_of", "render", "texture_at"]

Backend = Literal["auto", "reference", "cpu"]


class Rendering(NamedTuple):
    """Premultiplied RGBA over transparent black, 0..1. The alpha channel is the differentiable mask of the puppet."""

    rgba: Float[Tensor, "B H W 4"]


def render(
    vertices: Float[Tensor, "B V 2"],
    mesh: Mesh,
    texture: Texture,
    order: Int[Tensor, "B L"],
    size: tuple[int, int],
    opacity: Float[Tensor, "B L"] | None = None,
    backend: Backend = "auto",
) -> Rendering:
    """Draw a batch of frames; gradients reach ``vertices``, ``texture.rgba`` and ``opacity``.

    ``vertices`` are image pixels with a corner origin; those off the image are clipped. ``order[b]`` lists the layers
    back to front. ``size`` is (W, H). ``opacity[b, l]`` multiplies layer l's texture (1 where left out).
    A pixel is drawn where its centre lies in a triangle, by the top-left rule, once per layer.

    "cpu" is the fast path (float32 on the CPU); it stops behind 1023/1024 of coverage, so that where a layer is opaque
    nothing is known of what lies behind: keep mattes and opacities that learn at 255/256 at most. "reference" runs on
    any device in any floating type and truncates nothing. "auto" takes the fast path wherever it can run.
    Raises ValueError for vertices that are not finite, an order that is not a permutation, and sizes that disagree.
    """
    check_scene(vertices, mesh, texture, order, size, opacity)
    if opacity is None:
        opacity = vertices.new_ones(order.shape)
    if backend == "cpu" or (backend == "auto" and vertices.device.type == "cpu" and vertices.dtype == torch.float32):
        scene = scene_of(mesh, texture.uv, order, size)
        return Rendering(composite_cpu(vertices, texture.rgba, opacity, scene))
    rgba, uv = texture.rgba.to(vertices), texture.uv.to(vertices)
    device = vertices.device
    image = composite_reference(vertices, mesh.to(device), rgba, uv, order.to(device), size, opacity.to(vertices))
    return Rendering(image)


def check_scene(
    vertices: Tensor, mesh: Mesh, texture: Texture, order: Tensor, size: tuple[int, int], opacity: Tensor | None
) -> None:
    """Raise ValueError where the arguments of a rendering do not fit together."""
    expected = (len(vertices), mesh.num_layers)
    if vertices.ndim != 3 or vertices.shape[1:] != texture.uv.shape:
        raise ValueError(f"vertices must be (B, {len(texture.uv)}, 2), not {tuple(vertices.shape)}")
    if not bool(torch.isfinite(vertices.detach()).all()):
        raise ValueError("vertices must be finite numbers")
    if order.shape != expected or not torch.equal(order.sort(1).values, _identity(order)):
        raise ValueError(f"order must be {expected}, each row a permutation of the layers back to front")
    if opacity is not None and opacity.shape != expected:
        raise ValueError(f"opacity must be {expected}, not {tuple(opacity.shape)}")
    if min(size) < 1 or min(texture.rgba.shape[:2]) < 2:
        raise ValueError(f"size {size} must be at least 1x1 and the texture {tuple(texture.rgba.shape[:2])} 2x2")


def _identity(order: Tensor) -> Tensor:
    """List the layers 0..L for every frame."""
    return torch.arange(order.shape[1], device=order.device, dtype=order.dtype).expand(order.shape)
