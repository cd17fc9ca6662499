"""The puppet as a skeleton: from few numbers that can be mixed (turns, sizes, shifts, bends) to vertices.

Each part hangs at a pivot from its parent (``pose/tree.py``). With complex numbers for points of the plane, p_l the
pivot of part l at rest, theta and s its turn and log-size against its parent, o its shift in its parent's frame:

    A_l = exp(sum of (s + i theta) from the root to l)
    w_l = w_parent + A_parent (p_l - p_parent + o_l)
    x_v = A_l (r_v - p_l + sum_k q_k b_kv) + w_l           for the vertices v of part l, at rest in r_v

b are the part's own bends: one made up (a bow along its long axis), the rest the main ones of given vertices. A pose
is the vector [theta, s, o, q], whose mixes turn parts about their hinges instead of shrinking them. The root's shift
is its pivot's place. Lengths are canvas pixels over the puppet's size; places come out as given by ``vertices_of``.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Int
from torch import Tensor

from wildpuppet.pose.tree import tree_of
from wildpuppet.types import Puppet


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A puppet's tree and bends. ``rest`` is relative to each vertex's pivot, in units of the puppet's size.

    ``is_above[l, m]``: part m is l or an ancestor of l. ``steps`` from the parent's pivot to the part's (0: the root).
    """

    layer_of_vertex: Int[np.ndarray, "V"]
    parent: Int[np.ndarray, "L"]
    is_above: Bool[np.ndarray, "L L"]
    rest: Float[np.ndarray, "V 2"]
    steps: Float[np.ndarray, "L 2"]
    bends: Float[np.ndarray, "K V 2"]

    @property
    def num_layers(self) -> int:
        """Number of parts."""
        return len(self.parent)

    @property
    def num_numbers(self) -> int:
        """Length of a pose vector."""
        return 4 * self.num_layers + len(self.bends)


@dataclass(frozen=True, eq=False)
class Code:
    """Coordinates of poses: pose = mean + z directions, z = (pose - mean) coordinates."""

    mean: Float[np.ndarray, "P"]
    directions: Float[np.ndarray, "Z P"]
    coordinates: Float[np.ndarray, "P Z"]

    def codes(self, poses: Float[np.ndarray, "n P"]) -> Float[np.ndarray, "n Z"]:
        """Give the codes of pose vectors."""
        return np.asarray((poses - self.mean) @ self.coordinates)


def skeleton_of(puppet: Puppet) -> Skeleton:
    """Build the skeleton with one made-up bend per part."""
    tree = tree_of(puppet)
    count, size = puppet.num_layers, float(np.ptp(puppet.vertices, axis=0).max())
    parent, pivots = np.full(count, tree.root), np.zeros((count, 2))
    pivots[tree.root] = puppet.vertices[puppet.layer_of_vertex == tree.root].mean(0)
    is_above = np.eye(count, dtype=bool)
    for edge in tree.edges:
        parent[edge.child], pivots[edge.child] = edge.parent, edge.at
        is_above[edge.child] |= is_above[edge.parent]
    rest = (puppet.vertices - pivots[puppet.layer_of_vertex]) / size
    steps = (pivots - pivots[parent]) / size
    bows = np.stack([_bow(rest, puppet.layer_of_vertex == layer) for layer in range(count)])
    return Skeleton(puppet.layer_of_vertex, parent, is_above, rest, steps, bows)


def _bow(rest: Float[np.ndarray, "V 2"], mine: Bool[np.ndarray, "V"]) -> Float[np.ndarray, "V 2"]:
    """Displace a part's vertices sideways with the square of the way along its long axis from the pivot.

    A bow of 1 moves the far end by half the part's length.
    """
    bow, own = np.zeros_like(rest), rest[mine]
    _, _, axes = np.linalg.svd(own - own.mean(0), full_matrices=False)
    along = own @ axes[0]
    length = max(float(np.abs(along).max()), np.finfo(float).tiny)
    share = along / length
    bow[mine] = 0.5 * length * (share**2 - _best_line(share))[:, None] * np.array([-axes[0][1], axes[0][0]])
    return bow


def _best_line(share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """The line a + b x nearest to x^2: what a turn and a shift do already is no bend."""
    columns = np.stack([np.ones_like(share), share], 1)
    return np.asarray(columns @ np.linalg.lstsq(columns, share**2, rcond=None)[0])


def vertices_of(skeleton: "SkeletonTensors", poses: Float[Tensor, "B P"]) -> Float[Tensor, "B V 2"]:
    """Place the vertices; in the units in which the root's shift is given. Differentiable."""
    count = skeleton.is_above.shape[0]
    turns, sizes = poses[:, :count], poses[:, count : 2 * count]
    shifts, bends = poses[:, 2 * count : 4 * count].reshape(-1, count, 2), poses[:, 4 * count :]
    angle, size = turns @ skeleton.is_above.T, (sizes @ skeleton.is_above.T).exp()
    turned = torch.stack([size * angle.cos(), size * angle.sin()], -1)
    above = torch.where(skeleton.is_root[:, None], turned.new_tensor([1.0, 0.0]), turned[:, skeleton.parent])
    moved = times(above, skeleton.steps + shifts)
    pivots = torch.einsum("lm,bmc->blc", skeleton.is_above, moved)
    local = skeleton.rest + torch.einsum("bk,kvc->bvc", bends, skeleton.bends)
    return times(turned[:, skeleton.layer], local) + pivots[:, skeleton.layer]


def times(a: Float[Tensor, "*n 2"], b: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 2"]:
    """Multiply complex numbers."""
    real = a[..., 0] * b[..., 0] - a[..., 1] * b[..., 1]
    return torch.stack([real, a[..., 0] * b[..., 1] + a[..., 1] * b[..., 0]], -1)


def skeleton_from(tensors: Mapping[str, Tensor]) -> Skeleton:
    """Give the skeleton that is kept as buffers of a network."""
    arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
    rest, steps, bends = (arrays[name].astype(np.float64) for name in ("rest", "steps", "bends"))
    return Skeleton(arrays["layer"], arrays["parent"], arrays["is_above"] > 0, rest, steps, bends)


class SkeletonTensors(torch.nn.Module):
    """The skeleton as buffers of a network."""

    is_above: Tensor
    is_root: Tensor
    parent: Tensor
    steps: Tensor
    rest: Tensor
    layer: Tensor
    bends: Tensor

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        tensors = {
            "is_above": torch.from_numpy(skeleton.is_above).float(),
            "is_root": torch.from_numpy(skeleton.is_above.sum(1) == 1),
            "parent": torch.from_numpy(np.array(skeleton.parent)).long(),
            "steps": torch.from_numpy(skeleton.steps).float(),
            "rest": torch.from_numpy(skeleton.rest).float(),
            "layer": torch.from_numpy(np.array(skeleton.layer_of_vertex)).long(),
            "bends": torch.from_numpy(skeleton.bends).float(),
        }
        for name, tensor in tensors.items():
            self.register_buffer(name, tensor)


def poses_of(
    skeleton: Skeleton,
    vertices: Float[np.ndarray, "T V 2"],
    weight: Float[np.ndarray, "T V"],
    usual: Float[np.ndarray, "P"] | None = None,
) -> Float[np.ndarray, "T P"]:
    """Find the pose vectors that come nearest to given vertices.

    Turns lie within half a turn of their usual value: that of the pose ``usual``, else the mean over these vertices.
    """
    linear, shift = _similarities(skeleton, vertices, weight)
    parent, is_root = skeleton.parent, skeleton.is_above.sum(1) == 1
    above = np.where(is_root, 1.0, linear[:, parent])
    relative = linear / above
    moved = shift - np.where(is_root, 0.0, shift[:, parent])
    steps = skeleton.steps[:, 0] + 1j * skeleton.steps[:, 1]
    offsets = moved / above - steps
    turns = unwrapped(np.angle(relative), None if usual is None else usual[: skeleton.num_layers])
    bends = _bends_of(skeleton, vertices, linear, shift, weight)
    shifts = np.stack([offsets.real, offsets.imag], -1).reshape(len(vertices), -1)
    return np.concatenate([turns, np.log(np.abs(relative)), shifts, bends], 1)


def unwrapped(turns: Float[np.ndarray, "T L"], usual: Float[np.ndarray, "L"] | None = None) -> Float[np.ndarray, "T L"]:
    """Bring angles to within half a turn of each part's usual one; left out, that is their mean direction."""
    usual = np.angle(np.exp(1j * turns).sum(0)) if usual is None else usual
    return np.asarray(usual + np.angle(np.exp(1j * (turns - usual))))


def _similarities(
    skeleton: Skeleton, vertices: Float[np.ndarray, "T V 2"], weight: Float[np.ndarray, "T V"]
) -> tuple[Complex[np.ndarray, "T L"], Complex[np.ndarray, "T L"]]:
    """Each part's A (complex) and the place of its pivot, by weighted least squares."""
    rest = skeleton.rest[:, 0] + 1j * skeleton.rest[:, 1]
    places = vertices[..., 0] + 1j * vertices[..., 1]
    linear = np.empty((len(vertices), skeleton.num_layers), complex)
    shift = np.empty_like(linear)
    for layer in range(skeleton.num_layers):
        mine = skeleton.layer_of_vertex == layer
        share = weight[:, mine] / weight[:, mine].sum(1, keepdims=True)
        mean_rest, mean_place = share @ rest[mine], (share * places[:, mine]).sum(1)
        own, seen = rest[mine] - mean_rest[:, None], places[:, mine] - mean_place[:, None]
        spread = (share * np.abs(own) ** 2).sum(1)
        linear[:, layer] = (share * seen * own.conj()).sum(1) / np.maximum(spread, np.finfo(float).tiny)
        shift[:, layer] = mean_place - linear[:, layer] * mean_rest
    return linear, shift


def residuals(
    skeleton: Skeleton, vertices: Float[np.ndarray, "T V 2"], weight: Float[np.ndarray, "T V"]
) -> Float[np.ndarray, "T V 2"]:
    """What the parts' turns and shifts leave, in the parts' own frames at rest."""
    linear, shift = _similarities(skeleton, vertices, weight)
    return _left(skeleton, vertices, linear, shift)


def _left(
    skeleton: Skeleton,
    vertices: Float[np.ndarray, "T V 2"],
    linear: Complex[np.ndarray, "T L"],
    shift: Complex[np.ndarray, "T L"],
) -> Float[np.ndarray, "T V 2"]:
    """Take vertices into the parts' own frames; give what is left beside the rest shape."""
    of, rest = skeleton.layer_of_vertex, skeleton.rest[:, 0] + 1j * skeleton.rest[:, 1]
    left = (vertices[..., 0] + 1j * vertices[..., 1] - shift[:, of]) / linear[:, of] - rest
    return np.stack([left.real, left.imag], -1)


def _bends_of(
    skeleton: Skeleton,
    vertices: Float[np.ndarray, "T V 2"],
    linear: Complex[np.ndarray, "T L"],
    shift: Complex[np.ndarray, "T L"],
    weight: Float[np.ndarray, "T V"],
) -> Float[np.ndarray, "T K"]:
    """How much of each bend there is, part by part, by weighted least squares."""
    left = _left(skeleton, vertices, linear, shift)
    amounts = np.zeros((len(vertices), len(skeleton.bends)))
    owner = np.array([skeleton.layer_of_vertex[np.abs(bend).sum(1).argmax()] for bend in skeleton.bends])
    for layer in range(skeleton.num_layers):
        chosen, mine = np.flatnonzero(owner == layer), skeleton.layer_of_vertex == layer
        basis = skeleton.bends[chosen][:, mine].reshape(len(chosen), -1)
        for t in range(len(vertices)):
            heavy = np.repeat(np.sqrt(weight[t, mine]), 2)
            amounts[t, chosen] = np.linalg.lstsq((basis * heavy).T, left[t, mine].reshape(-1) * heavy, rcond=1e-3)[0]
    return amounts


def with_bends(
    skeleton: Skeleton, vertices: Float[np.ndarray, "T V 2"], weight: Float[np.ndarray, "T V"], number: int
) -> Skeleton:
    """Add each part's ``number`` main bends over given vertices, what the made-up ones explain taken out."""
    left = residuals(skeleton, vertices, weight) * np.sqrt(weight)[..., None]
    bends = [skeleton.bends]
    for layer in range(skeleton.num_layers):
        mine = skeleton.layer_of_vertex == layer
        own = left[:, mine].reshape(len(left), -1)
        bow = skeleton.bends[layer][mine].reshape(-1)
        bow = bow / max(float(np.linalg.norm(bow)), np.finfo(float).tiny)
        own = own - (own @ bow)[:, None] * bow
        _, values, axes = np.linalg.svd(own, full_matrices=False)
        kept = axes[: min(number, int((values > LEAST_BEND * np.sqrt(len(left) * mine.sum())).sum()))]
        added = np.zeros((len(kept), *skeleton.rest.shape))
        added[:, mine] = kept.reshape(len(kept), mine.sum(), 2) * np.sqrt(mine.sum())
        bends.append(added)
    grown = np.concatenate(bends)
    return Skeleton(skeleton.layer_of_vertex, skeleton.parent, skeleton.is_above, skeleton.rest, skeleton.steps, grown)


LEAST_BEND = 2.0e-4
"""Bends that move a part's vertices less than this, root mean square in puppet sizes, are noise."""
