"""One mesh file per frame for 3D tools: glTF (GLB) or Wavefront OBJ, written by trimesh.

Units are video pixels, x right, **y up** from the picture's upper left corner (so y is negative inside the picture),
triangles face +z. Each part is an object of its own under the part's name, and stands ``GAP`` nearer than the part
behind it, so that depth sorting draws them in order. GLB carries the atlas inside, unlit and blended by alpha; OBJ
files of a folder share puppet.mtl and atlas.png.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from jaxtyping import Float, Int
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.exchange.obj import export_obj
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from wildpuppet import atomic
from wildpuppet.export.meshes import unit_uv, vertices_video, write_atlas
from wildpuppet.export.pieces import facing_eye
from wildpuppet.export.whole import whole_file
from wildpuppet.machine import Progress, silent
from wildpuppet.types import Crops, Fit, Puppet

GAP = 1.0
"""Distance between neighbouring layers, in pixels."""

MATERIAL = "puppet"
MTL = f"""newmtl {MATERIAL}
Ka 1 1 1
Kd 1 1 1
Ks 0 0 0
illum 0
map_Kd atlas.png
map_d -imfchan m atlas.png
"""

Format = Literal["obj", "glb"]


def write_mesh_files(
    folder: Path, puppet: Puppet, crops: Crops, fit: Fit, kind: Format, progress: Progress = silent
) -> list[Path]:
    """Write frame_NUMBER.obj or .glb for every frame that has the character; frames in state lost have no file.

    Returns the files. Raises StoreError where the disk refuses.
    """
    material: PBRMaterial | SimpleMaterial
    if kind == "obj":
        write_atlas(folder / "atlas.png", puppet)
        atomic.write_text(folder / "puppet.mtl", MTL)
        material = SimpleMaterial(name=MATERIAL, image=Image.fromarray(puppet.atlas[:1, :1]))  # type: ignore[no-untyped-call]
    else:
        image = Image.fromarray(puppet.atlas)
        material = PBRMaterial(name=MATERIAL, baseColorTexture=image, alphaMode="BLEND", doubleSided=True)  # type: ignore[no-untyped-call]
    encode = ENCODERS[kind]
    placed = vertices_video(crops, fit)
    written = []
    for t, (number, state) in enumerate(zip(fit.frames, fit.state, strict=True)):
        if state != "lost":
            path = folder / f"frame_{int(number):06d}.{kind}"
            with whole_file(path) as beside:
                beside.write_bytes(encode(_scene(puppet, placed[t], fit.order[t], material)))
            written.append(path)
        progress(t + 1, len(fit.frames))
    return written


def _scene(
    puppet: Puppet,
    vertices: Float[np.ndarray, "V 2"],
    order: Int[np.ndarray, "L"],
    material: PBRMaterial | SimpleMaterial,
) -> trimesh.Scene:
    scene = trimesh.Scene()
    triangles = facing_eye(puppet)
    texture = unit_uv(puppet) * [1.0, -1.0] + [0.0, 1.0]  # trimesh counts v upwards and turns it for glTF
    for rank, layer in enumerate(order):
        mine = np.flatnonzero(puppet.layer_of_vertex == layer)
        places = np.column_stack([vertices[mine, 0], -vertices[mine, 1], np.full(len(mine), rank * GAP)])
        faces = triangles[puppet.layer_of_triangle == layer]
        look = TextureVisuals(uv=texture[mine], material=material)  # type: ignore[no-untyped-call]
        mesh = trimesh.Trimesh(places, np.searchsorted(mine, faces), visual=look, process=False)
        name = puppet.names[int(layer)]
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    return scene


def _glb(scene: trimesh.Scene) -> bytes:
    data = export_glb(scene, include_normals=False, tree_postprocessor=_unlit)  # type: ignore[no-untyped-call]
    return bytes(data)


def _unlit(tree: dict[str, Any]) -> None:
    """Show the drawing's own colours: no light falls on the material."""
    tree["extensionsUsed"] = sorted({*tree.get("extensionsUsed", ()), "KHR_materials_unlit"})
    for material in tree["materials"]:
        material["extensions"] = {**material.get("extensions", {}), "KHR_materials_unlit": {}}


def _obj(scene: trimesh.Scene) -> bytes:
    text, _ = export_obj(  # type: ignore[no-untyped-call]
        scene, include_normals=False, return_texture=True, mtl_name="puppet.mtl", header="wildpuppet"
    )
    return str(text).encode()


ENCODERS: dict[Format, Callable[[trimesh.Scene], bytes]] = {"obj": _obj, "glb": _glb}
