"""Runs inside Blender's Python (package bpy): python blender_cache.py PUPPET.obj CACHE COUNT OUT.npz.

Imports the OBJ, puts the cache on it with the Mesh Cache modifier, and stores the corners of frames 0 to COUNT - 1 and
the texture coordinates. The axes are given as they are in the files, so that nothing is turned.
"""

import sys

import bpy
import numpy as np


def main(shape: str, cache: str, count: str, out: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.obj_import(filepath=shape, forward_axis="Y", up_axis="Z")
    (item,) = (each for each in bpy.data.objects if each.type == "MESH")
    modifier = item.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = "MDD" if cache.endswith(".mdd") else "PC2"
    modifier.filepath = cache
    modifier.interpolation = "NONE"
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.frame_start = 0.0
    scene, places = bpy.context.scene, []
    for t in range(int(count)):
        scene.frame_set(t)
        seen = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = seen.to_mesh()
        corners = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", corners)
        places.append(corners.reshape(-1, 3))
        seen.to_mesh_clear()
    mesh = item.data
    uv = np.zeros((len(mesh.vertices), 2))
    for loop, texel in zip(mesh.loops, mesh.uv_layers[0].data, strict=True):
        uv[loop.vertex_index] = texel.uv
    image = item.active_material.node_tree.nodes["Image Texture"].image
    np.savez(out, corners=np.stack(places), uv=uv, image=np.array(image.size))


main(*sys.argv[1:])
