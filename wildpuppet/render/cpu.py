"""The fast CPU renderer: Numba kernels in a torch.autograd.Function, frames spread over threads."""

from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor
from torch.autograd.function import once_differentiable

from wildpuppet.render.gradient_kernels import walk_frames
from wildpuppet.render.kernels import composite_frames
from wildpuppet.render.mesh import Mesh
from wildpuppet.render.threads import run_shares, shares

TEXTURE_SHARES = 8
"""The texture's gradient is summed in this many parts whatever the number of threads, so that it does not vary."""


class Scene(NamedTuple):
    """What the kernels read and no gradient reaches. ``starts[l]`` is the first triangle of layer l."""

    triangles: Int64[np.ndarray, "F 3"]
    original: Int64[np.ndarray, "F"]
    starts: Int64[np.ndarray, "M"]
    uv: Float32[np.ndarray, "V 2"]
    order: Int64[np.ndarray, "B L"]
    size: tuple[int, int]


def scene_of(mesh: Mesh, uv: Tensor, order: Tensor, size: tuple[int, int]) -> Scene:
    """Group the triangles by layer and bring everything into the kernels' types."""
    layers = mesh.layer_of_triangle.numpy()
    original = np.argsort(layers, kind="stable")
    starts = np.searchsorted(layers[original], np.arange(mesh.num_layers + 1))
    triangles = np.ascontiguousarray(mesh.triangles.numpy()[original], np.int64)
    coordinates = np.ascontiguousarray(uv.detach().numpy(), np.float32)
    return Scene(triangles, original, starts, coordinates, np.ascontiguousarray(order.numpy(), np.int64), size)


def _array(tensor: Tensor) -> Float32[np.ndarray, "*_"]:
    array: Float32[np.ndarray, "*_"] = tensor.detach().contiguous().numpy()
    return array


def _frames(images: Tensor) -> Float32[np.ndarray, "B N"]:
    """View a batch of images with each one flat."""
    return _array(images).reshape(len(images), images.shape[1] * images.shape[2] * images.shape[3])


class Composite(torch.autograd.Function):
    """``apply(vertices, rgba, opacity, scene)`` -> (B, H, W, 4)."""

    @staticmethod
    def forward(ctx: Any, vertices: Tensor, rgba: Tensor, opacity: Tensor, scene: Scene) -> Tensor:
        """Render the batch."""
        width, height = scene.size
        image = torch.empty(len(vertices), height, width, 4)
        arguments = kernel_arguments(vertices, rgba, opacity, scene)
        out = _frames(image)
        run_shares(lambda _, first, end: composite_frames(first, end, *arguments, out), shares(len(vertices)))
        ctx.save_for_backward(vertices, rgba, opacity, image)
        ctx.scene = scene
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, Tensor | None, Tensor, None]:
        """Walk the same pixels again."""
        vertices, rgba, opacity, image = ctx.saved_tensors
        batch = len(vertices)
        to_vertices, to_opacity = torch.zeros_like(vertices), torch.zeros_like(opacity)
        runs = shares(batch, TEXTURE_SHARES if ctx.needs_input_grad[1] else None)
        to_texture = torch.zeros(len(runs), rgba.numel() if ctx.needs_input_grad[1] else 0)
        arguments = kernel_arguments(vertices, rgba, opacity, ctx.scene)
        images, upstreams = _frames(image), _frames(upstream)
        gradients = to_vertices.numpy(), to_opacity.numpy()

        def work(index: int, first: int, end: int) -> None:
            walk_frames(first, end, *arguments, images, upstreams, *gradients, to_texture[index].numpy())

        run_shares(work, runs)
        texture = to_texture.sum(0).reshape(rgba.shape) if ctx.needs_input_grad[1] else None
        return to_vertices, texture, to_opacity, None


def kernel_arguments(vertices: Tensor, rgba: Tensor, opacity: Tensor, scene: Scene) -> tuple[Any, ...]:
    """List the kernels' common arguments, in their order."""
    texture_size = (rgba.shape[1], rgba.shape[0])
    return (
        _array(vertices), scene.triangles, scene.starts, scene.uv, scene.order,
        _array(opacity), _array(rgba).reshape(-1), texture_size, scene.size,
    )  # fmt: skip


def composite_cpu(
    vertices: Float[Tensor, "B V 2"], rgba: Float[Tensor, "H W 4"], opacity: Float[Tensor, "B L"], scene: Scene
) -> Float[Tensor, "B h w 4"]:
    """Render a batch with the kernels; float32 on the CPU."""
    image: Tensor = Composite.apply(vertices.contiguous(), rgba.contiguous(), opacity.contiguous(), scene)  # type: ignore[no-untyped-call]
    return image
