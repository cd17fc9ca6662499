"""The parts as a tree: joints as springs, with loose springs where parts have no joint.

Dynamic programming wants a tree. Joints may form a forest (parts without a joint) or a cycle; a spanning tree is
taken over the joints, largest overlaps of size first, and what is still apart is tied by a loose spring to the nearest
part at rest.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wildpuppet.types import Puppet


@dataclass(frozen=True)
class Edge:
    """A spring from ``parent`` to ``child`` at ``at`` (canvas pixels at rest).

    ``is_hinge``: a joint of the puppet; ``is_bend``: both are pieces of one part.
    """

    parent: int
    child: int
    at: tuple[float, float]
    is_hinge: bool
    is_bend: bool = False


@dataclass(frozen=True)
class Tree:
    """A rooted tree over the layers; ``edges`` from the root outwards (a parent comes before its children)."""

    root: int
    edges: tuple[Edge, ...]

    def children(self, layer: int) -> tuple[Edge, ...]:
        """Edges from ``layer`` to its children."""
        return tuple(edge for edge in self.edges if edge.parent == layer)

    def below(self, layer: int) -> tuple[int, ...]:
        """List ``layer`` and everything that hangs from it."""
        found = [layer]
        for edge in self.edges:
            if edge.parent in found:
                found.append(edge.child)
        return tuple(found)


def part_areas(puppet: Puppet) -> Float[np.ndarray, "L"]:
    """Sum the rest triangles' areas of each layer, canvas pixels."""
    a, b, c = (puppet.vertices[puppet.triangles[:, k]] for k in range(3))
    doubled = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    return np.bincount(puppet.layer_of_triangle, doubled / 2, puppet.num_layers)


def joint_points(puppet: Puppet) -> Float[np.ndarray, "J 2 2"]:
    """Place each joint's two points at rest, canvas pixels."""
    points: Float[np.ndarray, "J 2 2"] = (puppet.vertices[puppet.joint_vertices] * puppet.joint_weights[..., None]).sum(
        -2
    )
    return points


def tree_of(puppet: Puppet, part: Int[np.ndarray, "L"] | None = None) -> Tree:
    """Build the spanning tree, rooted at the part whose removal leaves the smallest pieces (large parts preferred).

    ``part`` says which part each layer is a piece of, where parts were cut at their bends.
    """
    part = np.arange(puppet.num_layers) if part is None else part
    links = _joint_links(puppet, part)
    links += _loose_links(puppet, links)
    root = _center(puppet, links)
    edges: list[Edge] = []
    reached = [root]
    for layer in reached:
        for a, b, at, is_hinge in links:
            for parent, child in ((a, b), (b, a)):
                if parent == layer and child not in reached:
                    reached.append(child)
                    edges.append(Edge(parent, child, at, is_hinge, bool(part[parent] == part[child])))
    return Tree(root, tuple(edges))


_Link = tuple[int, int, tuple[float, float], bool]


def _joint_links(puppet: Puppet, part: Int[np.ndarray, "L"]) -> list[_Link]:
    areas = part_areas(puppet)
    is_bend = part[puppet.joint_layers[:, 0]] == part[puppet.joint_layers[:, 1]]
    middle = joint_points(puppet).mean(1) if len(puppet.joint_layers) else np.zeros((0, 2))
    by_size = sorted(range(len(middle)), key=lambda j: (not is_bend[j], -areas[puppet.joint_layers[j]].min()))
    group = list(range(puppet.num_layers))
    links: list[_Link] = []
    for j in by_size:
        a, b = (int(layer) for layer in puppet.joint_layers[j])
        if group[a] != group[b]:
            group = [group[a] if g == group[b] else g for g in group]
            links.append((a, b, (float(middle[j, 0]), float(middle[j, 1])), True))
    return links


def _loose_links(puppet: Puppet, links: list[_Link]) -> list[_Link]:
    """Tie each separate group to the rest: among parts that come about equally near at rest, the largest pair."""
    group = np.arange(puppet.num_layers)
    for a, b, _, _ in links:
        group[group == group[b]] = group[a]
    areas = part_areas(puppet)
    gaps, places = _rest_gaps(puppet)
    near = gaps.min() + 0.04 * float(np.ptp(puppet.vertices, axis=0).max())
    extra: list[_Link] = []
    main = group[np.argmax(np.bincount(group, areas, puppet.num_layers)[group])]
    while (group != main).any():
        between = np.where((group == main)[:, None] & (group != main)[None], np.maximum(gaps, near), np.inf)
        pairs = np.argwhere(between <= between.min())
        parent, child = (int(i) for i in pairs[np.argmax(areas[pairs[:, 0]] * areas[pairs[:, 1]])])
        extra.append((parent, child, (float(places[parent, child, 0]), float(places[parent, child, 1])), False))
        group[group == group[child]] = main
    return extra


def _rest_gaps(puppet: Puppet) -> tuple[Float[np.ndarray, "L L"], Float[np.ndarray, "L L 2"]]:
    """Least distance between the layers' rest vertices, and the middle of where it is reached."""
    num_layers, of_vertex = puppet.num_layers, puppet.layer_of_vertex
    gaps, places = np.full((num_layers, num_layers), np.inf), np.zeros((num_layers, num_layers, 2))
    for a in range(num_layers):
        for b in range(a):
            first, second = puppet.vertices[of_vertex == a], puppet.vertices[of_vertex == b]
            distance = np.linalg.norm(first[:, None] - second[None], axis=-1)
            i, j = np.unravel_index(np.argmin(distance), distance.shape)
            gaps[a, b] = gaps[b, a] = distance[i, j]
            places[a, b] = places[b, a] = (first[i] + second[j]) / 2
    return gaps, places


def _center(puppet: Puppet, links: list[_Link]) -> int:
    areas = part_areas(puppet)
    neighbours: dict[int, list[int]] = {layer: [] for layer in range(puppet.num_layers)}
    for a, b, _, _ in links:
        neighbours[a].append(b)
        neighbours[b].append(a)

    def piece(layer: int, without: int) -> float:
        return float(areas[layer]) + sum(piece(n, layer) for n in neighbours[layer] if n != without)

    def largest_rest(layer: int) -> float:
        return max((piece(n, layer) for n in neighbours[layer]), default=0.0) - float(areas[layer]) / 2

    return min(range(puppet.num_layers), key=largest_rest)
