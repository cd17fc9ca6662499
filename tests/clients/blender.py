"""Runs inside Blender's Python (package bpy), not ours: python blender.py COMMAND ARGUMENTS...

play FILE FIRST COUNT FPS OUT.npz     world positions of every shown mesh in every frame, and what the scene was set to
cache FILE.obj CACHE COUNT OUT.npz    world positions under the Mesh Cache modifier, from frame 0
render FILE FRAME WIDTH HEIGHT OUT.png   the imported camera's view
map_uv ST.exr PART ATLAS.png WIDTH HEIGHT OUT.exr   the atlas through a part's ST map, by the compositor
matte MATTES.exr NAME WIDTH HEIGHT OUT.exr          the Cryptomatte matte of a name, by the compositor
"""

import sys

import bpy
import numpy as np


def opened(path: str) -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if ".usd" in path:
        bpy.ops.wm.usd_import(filepath=path)
    elif path.endswith(".glb"):
        bpy.ops.import_scene.gltf(filepath=path)
    return bpy.context.scene


def play(path: str, first: str, count: str, fps: str, out: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = int(fps)
    if path.endswith(".glb"):  # glTF counts seconds: its frames are those of the scene's rate
        bpy.ops.import_scene.gltf(filepath=path)
    else:
        bpy.ops.wm.usd_import(filepath=path)
    scene, found = bpy.context.scene, {}
    render = scene.render
    found["scene"] = np.array([render.fps / render.fps_base, scene.frame_start, scene.frame_end])
    for t in range(int(count)):
        scene.frame_set(int(first) + t)
        graph = bpy.context.evaluated_depsgraph_get()
        for item in bpy.data.objects:
            if item.type != "MESH":
                continue
            seen = item.evaluated_get(graph)
            mesh = seen.to_mesh()
            places = np.empty(len(mesh.vertices) * 3, np.float32)
            mesh.vertices.foreach_get("co", places)
            world = np.array(seen.matrix_world)
            is_shown = not seen.hide_render and abs(np.linalg.det(world[:3, :3])) > 1e-9
            if is_shown:
                found[f"{item.name}|{t}"] = places.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
            seen.to_mesh_clear()
    np.savez(out, **found)


def cache(path: str, points: str, count: str, out: str) -> None:
    scene = opened("")
    bpy.ops.wm.obj_import(filepath=path)
    (item,) = [each for each in bpy.data.objects if each.type == "MESH"]
    modifier = item.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = points.rpartition(".")[2].upper()
    modifier.filepath, modifier.frame_start, modifier.interpolation = points, 0.0, "NONE"
    found = {}
    for t in range(int(count)):
        scene.frame_set(t)
        seen = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = seen.to_mesh()
        places = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", places)
        world = np.array(seen.matrix_world)
        found[str(t)] = places.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
        seen.to_mesh_clear()
    np.savez(out, **found)


def view(scene: bpy.types.Scene, width: str, height: str, out: str) -> None:
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = int(width), int(height), 100
    render.threads_mode, render.threads = "FIXED", 1
    scene.view_settings.view_transform = "Raw" if out.endswith(".exr") else "Standard"
    render.filepath = out
    settings = render.image_settings
    settings.file_format, settings.color_mode = ("OPEN_EXR" if out.endswith(".exr") else "PNG"), "RGBA"
    settings.color_depth = "32" if out.endswith(".exr") else "8"
    bpy.ops.render.render(write_still=True)


def render(path: str, frame: str, width: str, height: str, out: str) -> None:
    scene = opened(path)
    scene.frame_set(int(frame))
    scene.camera = next(item for item in bpy.data.objects if item.type == "CAMERA")
    scene.render.engine, scene.cycles.samples, scene.cycles.transparent_max_bounces = "CYCLES", 8, 64
    scene.render.film_transparent = True
    view(scene, width, height, out)


def compositor(image_path: str) -> tuple[bpy.types.Scene, bpy.types.NodeTree, bpy.types.Image]:
    scene = opened("")
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    tree = bpy.data.node_groups.new("compositor", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    scene.compositing_node_group = tree
    return scene, tree, bpy.data.images.load(image_path)


def finish(scene: bpy.types.Scene, tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, *how: str) -> None:
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(socket, end.inputs[0])
    view(scene, *how)


def map_uv(path: str, part: str, atlas: str, *how: str) -> None:
    scene, tree, image = compositor(path)
    maps = tree.nodes.new("CompositorNodeImage")
    maps.image = image
    texture = tree.nodes.new("CompositorNodeImage")
    texture.image = bpy.data.images.load(atlas)
    texture.image.colorspace_settings.name = "Non-Color"
    node = tree.nodes.new("CompositorNodeMapUV")
    node.inputs["Interpolation"].default_value = "Bilinear"
    tree.links.new(texture.outputs["Image"], node.inputs["Image"])
    tree.links.new(maps.outputs[part], node.inputs["UV"])
    finish(scene, tree, node.outputs["Image"], *how)


def matte(path: str, name: str, *how: str) -> None:
    scene, tree, image = compositor(path)
    node = tree.nodes.new("CompositorNodeCryptomatteV2")
    node.source, node.image = "IMAGE", image
    node.matte_id = name
    finish(scene, tree, node.outputs["Matte"], *how)


if __name__ == "__main__":
    globals()[sys.argv[1]](*sys.argv[2:])
