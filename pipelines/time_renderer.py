"""How fast the renderer is on this machine, beside the plain-torch reference: a person of twelve parts."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8

from wildpuppet.render.render import Backend, Mesh, Texture, mesh_of, render, texture_at
from wildpuppet.render.threads import use_threads
from wildpuppet.types import Puppet

NUM_PARTS = 12
CELLS = (6, 7)
"""Mesh cells of a part: 12 parts of 6 x 7 cells of two triangles are 1,008 triangles."""
CANVAS = 512
PARTS = (
    (110, 40, 60, 150), (345, 40, 60, 150), (180, 330, 70, 160), (262, 330, 70, 160), (165, 130, 185, 220),
    (175, 300, 165, 70), (190, 15, 135, 135), (95, 160, 70, 130), (350, 160, 70, 130), (150, 440, 95, 60),
    (265, 440, 95, 60), (225, 110, 65, 50),
)  # fmt: skip
"""x, y, w, h of each part on the canvas, back to front: two arms, legs, a torso, hips, a head, feet, a neck."""


class RendererRow(NamedTuple):
    """Milliseconds per frame of one backend at one size, the least of several runs."""

    pixels: int
    backend: Backend
    forward: float
    forward_backward: float


def benchmark_puppet() -> Puppet:
    """Build a person of twelve soft-edged boxes, 1,008 triangles and an atlas of 512 x 512."""
    columns, rows = CELLS
    grid = np.stack(np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1)), -1).reshape(-1, 2)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    right, below = corner + 1, corner + columns + 1
    cells = np.concatenate([np.stack([corner, right, below], 1), np.stack([right, below + 1, below], 1)])
    boxes = np.array(PARTS, np.float64)
    tiles = np.array([(8 + 126 * (i % 4), 8 + 166 * (i // 4)) for i in range(NUM_PARTS)], np.float64)
    sides = np.minimum(boxes[:, 2:], (120, 155))
    count = len(grid)
    return Puppet(
        names=tuple(f"part{i}" for i in range(NUM_PARTS)),
        canvas=(CANVAS, CANVAS),
        vertices=(boxes[:, None, :2] + grid * boxes[:, None, 2:]).reshape(-1, 2),
        triangles=(np.arange(NUM_PARTS)[:, None, None] * count + cells).reshape(-1, 3),
        layer_of_vertex=np.repeat(np.arange(NUM_PARTS), count),
        uv=(tiles[:, None] + grid * sides[:, None]).reshape(-1, 2),
        atlas=_atlas(tiles, sides),
        joint_layers=np.zeros((0, 2), np.int64),
        joint_vertices=np.zeros((0, 2, 3), np.int64),
        joint_weights=np.zeros((0, 2, 3)),
    )


def _atlas(tiles: Float[np.ndarray, "L 2"], sides: Float[np.ndarray, "L 2"]) -> UInt8[np.ndarray, "H W 4"]:
    """Paint noise whose alpha fades to 0 four pixels inside each tile."""
    atlas = np.random.default_rng(0).integers(0, 256, (CANVAS, CANVAS, 4), dtype=np.uint8)
    atlas[..., 3] = 0
    for (x, y), (w, h) in zip(tiles.astype(int), sides.astype(int), strict=True):
        atlas[y + 4 : y + h - 4, x + 4 : x + w - 4, 3] = 255
    return atlas


def measure_renderer(
    sizes: tuple[int, ...] = (128, 256, 512),
    backends: tuple[Backend, ...] = ("cpu", "reference"),
    num_frames: int = 8,
    seconds: float = 2.0,
    num_threads: int = 1,
) -> list[RendererRow]:
    """Time the renderer on twelve parts, each row for about ``seconds``; every frame has its own vertices and order.

    torch and the kernels both use ``num_threads`` from here on in this process. One thread is timed by the processor's
    clock, which other work on the machine does not disturb; several by the wall's.
    """
    torch.set_num_threads(num_threads)
    use_threads(num_threads)
    puppet = benchmark_puppet()
    mesh, rng = mesh_of(puppet), np.random.default_rng(1)
    order = torch.from_numpy(np.stack([rng.permutation(NUM_PARTS) for _ in range(num_frames)]))
    clock = time.process_time if num_threads == 1 else time.perf_counter
    rows = []
    for pixels in sizes:
        scale = pixels / CANVAS
        shake = rng.normal(0.0, 0.4, (num_frames, len(puppet.vertices), 2))
        vertices = torch.tensor(puppet.vertices * scale + shake, dtype=torch.float32)
        texture = texture_at(puppet, 1.0)
        for backend in backends:
            forward, both = _time_scene(vertices, mesh, texture, order, pixels, backend, seconds, clock)
            rows.append(RendererRow(pixels, backend, 1e3 * forward / num_frames, 1e3 * both / num_frames))
    return rows


def _time_scene(
    vertices: torch.Tensor,
    mesh: Mesh,
    texture: Texture,
    order: torch.Tensor,
    pixels: int,
    backend: Backend,
    seconds: float,
    clock: Callable[[], float],
) -> tuple[float, float]:
    """Least seconds of a forward call and of a forward and backward call."""
    moving = vertices.clone().requires_grad_()
    upstream = torch.randn(len(vertices), pixels, pixels, 4)

    def forward() -> None:
        render(vertices, mesh, texture, order, (pixels, pixels), backend=backend)

    def both() -> None:
        moving.grad = None
        render(moving, mesh, texture, order, (pixels, pixels), backend=backend).rgba.backward(upstream)  # type: ignore[no-untyped-call]

    return _least_time(forward, seconds / 2, clock), _least_time(both, seconds / 2, clock)


def _least_time(work: Callable[[], None], seconds: float, clock: Callable[[], float]) -> float:
    """Least seconds of one call, after one call to warm up."""
    work()
    least, stop = float("inf"), time.perf_counter() + seconds
    while time.perf_counter() < stop or least == float("inf"):
        begin = clock()
        work()
        least = min(least, clock() - begin)
    return least
