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
    rgba, uv, opacity = texture.rgba.to(vertices), texture.uv.to(vertices), opacity.to(vertices)
    if uses_kernels(vertices, backend):
        return Rendering(composite_cpu(vertices, rgba, opacity, scene_of(mesh, uv, order, size)))
    placed, order = mesh.to(vertices.device), order.to(vertices.device)
    return Rendering(composite_reference(vertices, placed, rgba, uv, order, size, opacity))


def uses_kernels(vertices: Tensor, backend: Backend) -> bool:
    """Tell whether the fast path draws these; raises ValueError where it was asked for and cannot."""
    fits = vertices.device.type == "cpu" and vertices.dtype == torch.float32
    if backend == "cpu" and not fits:
        raise ValueError(f"backend cpu needs float32 vertices on the CPU, not {vertices.dtype} on {vertices.device}")
    return fits and backend != "reference"


def check_scene(
    vertices: Tensor, mesh: Mesh, texture: Texture, order: Tensor, size: tuple[int, int], opacity: Tensor | None
) -> None:
    """Raise ValueError where the arguments of a rendering do not fit together."""
    expected = (len(vertices), mesh.num_layers)
    if vertices.ndim != 3 or vertices.shape[1:] != texture.uv.shape:
        raise ValueError(f"vertices must be (B, {len(texture.uv)}, 2), not {tuple(vertices.shape)}")
    if not bool(torch.isfinite(vertices.detach()).all()):
        raise ValueError("vertices must be finite numbers")
    if len(mesh.triangles) and not 0 <= int(mesh.triangles.min()) <= int(mesh.triangles.max()) < len(texture.uv):
        raise ValueError(f"triangles must name vertices 0 to {len(texture.uv) - 1}")
    if order.shape != expected or not torch.equal(order.sort(1).values, _identity(order)):
        raise ValueError(f"order must be {expected}, each row a permutation of the layers back to front")
    if opacity is not None and opacity.shape != expected:
        raise ValueError(f"opacity must be {expected}, not {tuple(opacity.shape)}")
    if min(size) < 1 or min(texture.rgba.shape[:2]) < 2:
        raise ValueError(f"size {size} must be at least 1x1 and the texture {tuple(texture.rgba.shape[:2])} 2x2")


def _identity(order: Tensor) -> Tensor:
    """List the layers 0..L for every frame."""
    return torch.arange(order.shape[1], device=order.device, dtype=order.dtype).expand(order.shape)
