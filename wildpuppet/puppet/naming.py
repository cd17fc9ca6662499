"""Guessed names for the parts of an automatic puppet: what sticks out where. Left and right are the picture's."""

import numpy as np
from jaxtyping import Float

from wildpuppet.puppet.skeleton import Skeleton

LOW_SHARE = 0.85
"""A limb whose tip lies below this share of the character's height is a leg."""
HEAD_SHARE = 0.4
"""A limb that points up is the head if it is at least this share as thick as the body, else an arm."""


def part_names(skeleton: Skeleton, cuts: list[int], parents: list[int]) -> list[str]:
    """Name the body and the parts that begin at each cut; ``parents[i]`` is the part (0: body) that cut i hangs on."""
    tips = [_tip(skeleton, node) for node in cuts]
    roots = [index for index, parent in enumerate(parents) if parent == 0]
    kinds = {index: _kind(skeleton, cuts[index], tips[index]) for index in roots}
    heads = [index for index in roots if kinds[index] == "head"]
    head = max(heads, key=lambda index: _thickness(skeleton, cuts[index]), default=None)
    kinds |= {index: "arm" for index in heads if index != head}
    names: dict[int, str] = {0: "body"}
    for kind in ("head", "leg", "arm"):
        alike = sorted((index for index in roots if kinds[index] == kind), key=lambda index: float(tips[index][0]))
        names |= {index + 1: f"{kind}{_suffix(place, len(alike))}" for place, index in enumerate(alike)}
    further: dict[int, int] = {}
    for index in sorted(set(range(len(cuts))) - set(roots), key=lambda index: float(skeleton.depth[cuts[index]])):
        root = _root(index + 1, parents)
        further[root] = further.get(root, 1) + 1
        names[index + 1] = f"{names[root]}_part{further[root]}"
    return [names[part] for part in range(len(cuts) + 1)]


def _suffix(place: int, count: int) -> str:
    if count == 1:
        return ""
    return ("_left", "_right")[place] if count == 2 else f"_{place + 1}"


def _root(part: int, parents: list[int]) -> int:
    """Find the limb on the body that a part belongs to."""
    while parents[part - 1]:
        part = parents[part - 1]
    return part


def _tip(skeleton: Skeleton, node: int) -> Float[np.ndarray, "2"]:
    onward = skeleton.toward_tip()
    while onward[node] != node:
        node = int(onward[node])
    tip: Float[np.ndarray, " 2"] = skeleton.points[node]
    return tip


def _kind(skeleton: Skeleton, node: int, tip: Float[np.ndarray, "2"]) -> str:
    low, high = (skeleton.points[:, 1] - skeleton.radius).min(), (skeleton.points[:, 1] + skeleton.radius).max()
    away = tip - skeleton.points[node]
    if tip[1] > low + LOW_SHARE * (high - low) and away[1] > 0.0:
        return "leg"
    is_head = -away[1] > 0.5 * abs(away[0]) and _thickness(skeleton, node) >= HEAD_SHARE * skeleton.radius[0]
    return "head" if is_head else "arm"


def _thickness(skeleton: Skeleton, node: int) -> float:
    """Measure the largest radius from a node outwards."""
    found = {node}
    for other in range(node + 1, len(skeleton.parent)):
        if int(skeleton.parent[other]) in found:
            found.add(other)
    return float(skeleton.radius[sorted(found)].max())
