"""The chosen poses of one shot, judged again by the pictures: what is decided over time goes by this.

Draw orders are: a part that passes in front of another in one drawing hardly does so in that one alone. Each drawing
says little where little shows, and the search takes it by itself; over the shot a change of order is paid for once,
not in every drawing.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from wildpuppet.pose import evidence as ev
from wildpuppet.pose.choose import best_path
from wildpuppet.pose.look import SIZE_STEP
from wildpuppet.pose.place import pose_vertices, rest_box, size_of
from wildpuppet.pose.tree import part_areas
from wildpuppet.render.render import Mesh, mesh_of
from wildpuppet.render.surface import surface
from wildpuppet.render.texture import Texture, texture_at
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Crops, Puppet


@dataclass(frozen=True, eq=False)
class Shot:
    """One shot's distinct drawings in order: indices of crops, poses and orders; what is found is written into them."""

    puppet: Puppet
    crops: Crops
    settings: SearchSettings
    index: Int[np.ndarray, "n"]
    maps: Float[np.ndarray, "n L 2 3"]
    order: Int[np.ndarray, "n L"]
    is_fixed: Bool[np.ndarray, "n"]
    pictures: dict[int, ev.Evidence] = field(default_factory=dict)
    textures: dict[int, Texture] = field(default_factory=dict)

    @cached_property
    def mesh(self) -> Mesh:
        """The puppet's mesh."""
        return mesh_of(self.puppet)

    @cached_property
    def scale(self) -> float:
        """Search pixels per crop pixel."""
        size = float(np.median([size_of(maps[0]) for maps in self.maps]))
        return self.settings.box_pixels / max(1.0, float(rest_box(self.puppet)[2:].max()) * size)

    def texture(self, row: int) -> Texture:
        """Give the puppet's texture at a drawing's size."""
        step = round(float(np.log(size_of(self.maps[row, 0]) * self.scale) / np.log(SIZE_STEP)))
        if step not in self.textures:
            self.textures[step] = ev.lab_texture(texture_at(self.puppet, SIZE_STEP**step))
        return self.textures[step]

    def costs(
        self, row: int, maps: Float[np.ndarray, "B L 2 3"], order: Int[np.ndarray, "B L"] | None = None
    ) -> Float[np.ndarray, "B"]:
        """Judge poses of a drawing by the composite, in units of an average part's evidence; ``order``: other ones."""
        if row not in self.pictures:
            crop = int(self.index[row])
            self.pictures[row] = ev.evidence_of(self.crops.images[crop : crop + 1][0], self.scale)
        area = part_areas(self.puppet) * (size_of(self.maps[row, 0]) * self.scale) ** 2
        unit = float(np.sqrt(area / area.mean()).sum() / area.sum())
        order = np.repeat(self.order[row][None], len(maps), 0) if order is None else order
        vertices = pose_vertices(self.puppet, maps) * self.scale
        return unit * ev.unexplained_cost(self.pictures[row], vertices, order, self.mesh, self.texture(row))

    def seen(self) -> Float[np.ndarray, "n L"]:
        """Measure how much of each part's area is seen in each drawing."""
        width, height = (max(8, round(side * self.scale)) for side in self.crops.size)
        shares = []
        for row, maps in enumerate(self.maps):
            vertices = torch.from_numpy((pose_vertices(self.puppet, maps[None]) * self.scale).astype(np.float32))
            order = torch.from_numpy(np.array(self.order[row][None]))
            layer = surface(vertices, self.mesh, self.texture(row), order, (width, height)).layer.numpy()
            count = np.bincount(layer[layer >= 0], minlength=self.puppet.num_layers)
            shares.append(count / (part_areas(self.puppet) * (size_of(maps[0]) * self.scale) ** 2))
        return np.stack(shares)


def keep_orders(shot: Shot) -> None:
    """Choose each drawing's order among those of the shot: what the pictures say, and each change at its price."""
    orders = np.unique(np.concatenate([shot.order, np.arange(shot.puppet.num_layers)[None]]), axis=0)
    if (np.diff(shot.order) > 0).all():
        return
    canonical = (np.diff(orders, axis=1) > 0).all(1)
    costs = np.stack(
        [shot.costs(row, np.repeat(maps[None], len(orders), 0), orders) for row, maps in enumerate(shot.maps)]
    )
    fixed = (orders[None] == shot.order[:, None]).all(-1)
    costs = np.where(shot.is_fixed[:, None] & ~fixed, np.inf, costs)
    costs[0] += shot.settings.reorder * ~canonical
    change = shot.settings.reorder * (1.0 - np.eye(len(orders)))
    shot.order[:] = orders[best_path(costs, [change] * (len(costs) - 1))]
