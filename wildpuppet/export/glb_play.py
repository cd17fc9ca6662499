"""Play a GLB file with stepped keys: where every vertex of every shown mesh is at a time. To check what we wrote."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wildpuppet.export.glb_file import Opened

SHOWS = 1e-6
"""A node scaled to less than this is hidden."""


class Player:
    """An opened file. Nodes may move, turn about z and scale, as ours do."""

    def __init__(self, path: Path) -> None:
        self._file = Opened(path)
        tree = self._file.tree
        self._nodes: list[dict[str, Any]] = tree["nodes"]
        animation = tree.get("animations", [{"samplers": [], "channels": []}])[0]
        self._keys = [
            (self._file.array(sampler["input"]), self._file.array(sampler["output"]))
            for sampler in animation["samplers"]
        ]
        self._moved = {
            (channel["target"]["node"], channel["target"]["path"]): channel["sampler"]
            for channel in animation["channels"]
        }

    def frame(self, seconds: float) -> dict[str, Float[np.ndarray, "n 3"]]:
        """Give the vertices of the shown meshes by mesh name."""
        found: dict[str, Float[np.ndarray, "n 3"]] = {}
        (root,) = self._file.tree["scenes"][0]["nodes"]
        self._walk(root, np.eye(3), np.zeros(3), seconds, found)
        return found

    def _walk(
        self,
        number: int,
        linear: Float[np.ndarray, "3 3"],
        shift: Float[np.ndarray, "3"],
        seconds: float,
        found: dict[str, Float[np.ndarray, "n 3"]],
    ) -> None:
        node = self._nodes[number]
        shift = shift + linear @ self._value(number, "translation", seconds, np.zeros(3))
        turn = _about_z(self._value(number, "rotation", seconds, np.array([0.0, 0.0, 0.0, 1.0])))
        linear = linear @ turn @ np.diag(self._value(number, "scale", seconds, np.ones(3)))
        if np.abs(linear).max() < SHOWS:
            return
        if "mesh" in node:
            mesh = self._file.tree["meshes"][node["mesh"]]
            found[mesh["name"]] = self._morphed(number, mesh["primitives"][0], seconds) @ linear.T + shift
        for child in node.get("children", ()):
            self._walk(child, linear, shift, seconds, found)

    def _morphed(self, number: int, primitive: dict[str, Any], seconds: float) -> Float[np.ndarray, "n 3"]:
        vertices = self._file.array(primitive["attributes"]["POSITION"]).astype(np.float64)
        targets = primitive.get("targets", [])
        weights = self._value(number, "weights", seconds, np.zeros(len(targets)))
        for target in np.flatnonzero(weights):
            vertices = vertices + weights[target] * self._file.array(targets[target]["POSITION"])
        return vertices

    def _value(self, number: int, path: str, seconds: float, default: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Give what a node's translation, scale or weights are at a time."""
        sampler = self._moved.get((number, path))
        if sampler is None:
            return np.array(self._nodes[number].get(path, default), np.float64)
        times, values = self._keys[sampler]
        key = max(int(np.searchsorted(times, seconds, "right")) - 1, 0)
        return np.asarray(values.reshape(len(times), -1)[key], np.float64)


def _about_z(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """Turn a unit quaternion about z into a matrix."""
    _, _, z, w = quaternion
    cos, sin = w * w - z * z, 2 * z * w
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
