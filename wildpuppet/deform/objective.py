"""What the deformation network is trained to lower: the terms of ``wildpuppet.fit.energy`` for one puppet in one run.

As printed in Neural Puppet (sections 3.2 and 3.4): ARAP over vertex cells against the placed rest shape, and the
area of the whole mask against the rest pose's. Ours: ARAP over triangles and the area of each layer, both against the
rest shape at the frame's own scale, so that neither a zoom nor a limb that crosses the body counts as deformation.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from wildpuppet.fit import energy
from wildpuppet.geometry.arap import arap_energy, cell_energy
from wildpuppet.pose.place import pose_vertices
from wildpuppet.render.render import Mesh, Texture, mesh_of, render, texture_at
from wildpuppet.settings import FitSettings
from wildpuppet.types import Crops, Poses, Puppet

Terms = dict[str, Tensor]
TERMS = ("reconstruction", "arap", "joints", "area")


def closest_similar(shape: Float[np.ndarray, "V 2"], target: Float[np.ndarray, "V 2"]) -> Float[np.ndarray, "V 2"]:
    """Move, turn and scale a shape as near as possible to a target (least squares); never mirrored."""
    own, centre = shape - shape.mean(0), target.mean(0)
    before, after = own @ np.array([1.0, 1.0j]), (target - centre) @ np.array([1.0, 1.0j])
    turned = before * (np.vdot(before, after) / max(np.vdot(before, before).real, np.finfo(float).tiny))
    return np.asarray(np.stack([turned.real, turned.imag], -1) + centre)


def scales_of(poses: Poses) -> Float[np.ndarray, "T"]:
    """Crop pixels per canvas pixel in each frame: the median over the parts."""
    areas = np.abs(np.linalg.det(poses.crop_from_canvas[..., :2]))
    return np.asarray(np.median(np.sqrt(areas), axis=1), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Objective:
    """The energy of one puppet in crops of one size; build with ``objective_of``.

    ``base`` is the placed rest pose (crop pixels), ``rest`` the same on the canvas, ``initial_mask`` base's alpha.
    """

    puppet: Puppet
    mesh: Mesh
    texture: Texture
    size: tuple[int, int]
    base: Float[Tensor, "V 2"]
    initial_mask: Float[Tensor, "1 H W"]
    rest: Float[Tensor, "V 2"]
    joint_vertices: Int[Tensor, "J 2 3"]
    joint_weights: Float[Tensor, "J 2 3"]
    as_printed: bool

    def terms(
        self,
        vertices_unit: Float[Tensor, "B V 2"],
        target: Float[Tensor, "B H W 3"],
        order: Int[Tensor, "B L"],
        scales: Float[Tensor, "B"],
    ) -> Terms:
        """Compute each term of each frame before weighting; ``target`` RGB 0..255, ``scales`` as ``scales_of``."""
        vertices = energy.from_unit(vertices_unit, self.size)
        rendered = render(vertices, self.mesh, self.texture, order, self.size).rgba
        triangles, layers, unit = self.mesh.triangles, self.mesh.layer_of_triangle, 2.0 / max(self.size)
        if self.as_printed:
            rigid = cell_energy(vertices_unit, self.base * unit, triangles)
            area = energy.mask_area(rendered[..., 3], self.initial_mask)
        else:
            rigid = arap_energy(vertices_unit, self.rest, triangles, scales * unit)
            area = energy.layer_area(vertices, self.rest * scales[:, None, None], triangles, layers)
        return {
            "reconstruction": energy.masked_reconstruction(target, rendered),
            "arap": rigid,
            "joints": energy.joint_distance(vertices_unit, self.joint_vertices, self.joint_weights),
            "area": area,
        }


def weighted(terms: Terms, fit: FitSettings) -> Tensor:
    """Add the weighted terms, averaged over the frames."""
    weights = {"reconstruction": fit.reconstruction, "arap": fit.arap, "joints": fit.joints, "area": fit.area}
    return torch.stack([weights[name] * terms[name].mean() for name in TERMS]).sum()


def objective_of(puppet: Puppet, crops: Crops, poses: Poses, as_printed: bool, device: torch.device) -> Objective:
    """Prepare the energy; the rest pose is placed as in the reference frame (the first, where there is none)."""
    reference = crops.reference or 0
    base = closest_similar(puppet.vertices, pose_vertices(puppet, poses.crop_from_canvas[reference]))
    mesh, texture = mesh_of(puppet), texture_at(puppet, float(scales_of(poses)[reference]))
    mesh = Mesh(mesh.triangles.to(device), mesh.layer_of_triangle.to(device), mesh.num_layers)
    texture = Texture(texture.rgba.to(device), texture.uv.to(device))

    def on_device(array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=torch.float32, device=device)

    order = torch.arange(puppet.num_layers, device=device)[None]
    mask = render(on_device(base)[None], mesh, texture, order, crops.size).rgba[..., 3]
    return Objective(
        puppet=puppet,
        mesh=mesh,
        texture=texture,
        size=crops.size,
        base=on_device(base),
        initial_mask=mask,
        rest=on_device(puppet.vertices),
        joint_vertices=torch.tensor(puppet.joint_vertices, dtype=torch.int64, device=device),
        joint_weights=on_device(puppet.joint_weights),
        as_printed=as_printed,
    )
