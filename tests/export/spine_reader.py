"""Reads Spine 4.2 files as the published format describes them: what stands where at a time."""

import json
import math
from bisect import bisect_right

import numpy as np


class Skeleton:
    def __init__(self, folder, stem):
        self.tree = json.loads((folder / f"{stem}.json").read_text())
        self.regions, self.page = self._atlas((folder / f"{stem}.atlas").read_text())
        ((_, self.motion),) = self.tree["animations"].items()
        self.slots = [slot["name"] for slot in self.tree["slots"]]

    def _atlas(self, text):
        lines = text.splitlines()
        regions = {
            name: [int(word) for word in bounds.removeprefix("bounds: ").split(",")]
            for name, bounds in zip(lines[4::2], lines[5::2], strict=True)
        }
        return regions, lines[0]

    def value(self, keys, time, names, default):
        """Interpolate a timeline: linear unless stepped, and the first key's value before it."""
        place = max(bisect_right([key.get("time", 0.0) for key in keys], time) - 1, 0)
        key = keys[place]
        here = np.array([np.asarray(key.get(name, default), float) for name in names])
        if place + 1 == len(keys) or key.get("curve") == "stepped":
            return here
        after = keys[place + 1]
        there = np.array([np.asarray(after.get(name, default), float) for name in names])
        share = (time - key.get("time", 0.0)) / (after["time"] - key.get("time", 0.0))
        return here + (there - here) * max(share, 0.0)

    def world(self, name, time):
        """The bone's matrix: parent's times turn, scale, shear and shift."""
        bone = next(bone for bone in self.tree["bones"] if bone["name"] == name)
        moves = self.motion["bones"].get(name, {})
        shift = np.array([bone.get("x", 0.0), bone.get("y", 0.0)])
        if "translate" in moves:
            shift = shift + self.value(moves["translate"], time, "xy", 0.0)
        turn = self.value(moves["rotate"], time, ["value"], 0.0)[0] if "rotate" in moves else 0.0
        scale = self.value(moves["scale"], time, "xy", 1.0) if "scale" in moves else np.ones(2)
        shear = self.value(moves["shear"], time, "xy", 0.0) if "shear" in moves else np.zeros(2)
        x, y = math.radians(turn + shear[0]), math.radians(turn + 90.0 + shear[1])
        own = np.array(
            [[math.cos(x) * scale[0], math.cos(y) * scale[1]], [math.sin(x) * scale[0], math.sin(y) * scale[1]]]
        )
        matrix = np.vstack([np.column_stack([own, shift]), [0.0, 0.0, 1.0]])
        return self.world(bone["parent"], time) @ matrix if "parent" in bone else matrix

    def is_shown(self, slot, time):
        keys = self.motion["slots"][slot]["attachment"]
        return keys[max(bisect_right([key["time"] for key in keys], time) - 1, 0)]["name"] is not None

    def order(self, time):
        keys = self.motion["drawOrder"]
        offsets = keys[max(bisect_right([key["time"] for key in keys], time) - 1, 0)].get("offsets", [])
        order = [None] * len(self.slots)
        for entry in offsets:
            order[self.slots.index(entry["slot"]) + entry["offset"]] = entry["slot"]
        left = iter(slot for slot in self.slots if slot not in order)
        return [slot if slot is not None else next(left) for slot in order]

    def mesh(self, slot, time):
        """World corners, texels and triangles of a slot's mesh."""
        said = self.tree["skins"][0]["attachments"][slot][slot]
        rest = np.array(said["vertices"]).reshape(-1, 2)
        keys = self.motion["attachments"]["default"][slot][slot]["deform"]
        own = rest + self.value(keys, time, ["vertices"], 0.0)[0].reshape(-1, 2)
        bone = next(each["bone"] for each in self.tree["slots"] if each["name"] == slot)
        world = self.world(bone, time)
        x, y, width, height = self.regions[said["path"]]
        texels = np.array(said["uvs"]).reshape(-1, 2) * (width, height) + (x, y)
        return own @ world[:2, :2].T + world[:2, 2], texels, np.array(said["triangles"]).reshape(-1, 3)
