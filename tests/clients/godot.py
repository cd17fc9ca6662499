"""A Godot 4 project in one .pck, for the engine's web build: texts as they are, pictures as Godot imports them."""

import hashlib
import io
import struct
from pathlib import Path

from PIL import Image

PCK, PCK_VERSION, ALIGN = b"GDPC", 2, 16
RGBA8, PNG_INSIDE = 5, 1

PROJECT = """config_version=5
[application]
config/name="client"
run/main_scene="res://main.tscn"
[display]
window/size/viewport_width={width}
window/size/viewport_height={height}
window/stretch/mode="disabled"
[rendering]
renderer/rendering_method="gl_compatibility"
renderer/rendering_method.web="gl_compatibility"
viewport/transparent_background=true
textures/canvas_textures/default_texture_filter=1
2d/snap/snap_2d_transforms_to_pixel=false
"""

MAIN = """[gd_scene load_steps=2 format=3]

[ext_resource type="Script" path="res://main.gd" id="1"]

[node name="Main" type="Node2D"]
script = ExtResource("1")
"""

SCRIPT = """extends Node2D

const MOMENTS = {moments}

func say(value):
	JavaScriptBridge.eval("fetch('/', {{method: 'POST', body: '" + JSON.stringify(value) + "'}})")

func _ready():
	get_viewport().transparent_bg = true
	var packed = load("res://{scene}")
	if packed == null:
		say({{"error": "the scene does not load"}})
		return
	var puppet = packed.instantiate()
	add_child(puppet)
	var player = puppet.get_node("AnimationPlayer")
	var window = puppet.get_node("Window")
	var found = []
	for moment in MOMENTS:
		if not player.has_animation(moment[0]):
			say({{"error": "no animation " + moment[0] + ", but " + str(player.get_animation_list())}})
			return
		player.play(moment[0])
		player.seek(moment[1], true)
		player.pause()
		await get_tree().process_frame
		await RenderingServer.frame_post_draw
		var nodes = {{}}
		for node in window.get_children():
			var places = []
			if node is Polygon2D:
				for corner in node.polygon:
					var place = window.transform * node.transform * corner
					places.append([place.x, place.y])
				nodes[node.name] = {{"places": places, "z": node.z_index}}
			else:
				var place = window.transform * node.position
				nodes[node.name] = {{"places": [[place.x, place.y]], "z": 0}}
		var image = get_viewport().get_texture().get_image()
		image.convert(Image.FORMAT_RGBA8)
		var picture = Marshalls.raw_to_base64(image.save_png_to_buffer())
		found.append({{"nodes": nodes, "visible": window.visible, "picture": picture}})
	say({{"found": found, "version": Engine.get_version_info().string, "lengths": lengths(player)}})

func lengths(player):
	var every = {{}}
	for name in player.get_animation_list():
		every[name] = player.get_animation(name).length
	return every
"""

PAGE = """<!doctype html><body><canvas id="canvas" width="{width}" height="{height}"></canvas>
<script src="index.js"></script><script>
const engine = new Engine({{executable: 'index', mainPack: 'client.pck', canvas: document.getElementById('canvas'),
  canvasResizePolicy: 0, args: ['--resolution', '{width}x{height}'], fileSizes: {{}},
  onPrintError: (...words) => console.error(...words)}});
engine.startGame().catch((error) => fetch('/', {{method: 'POST', body: JSON.stringify({{error: String(error)}})}}));
</script></body>"""


def write_project(folder: Path, engine: Path, export: Path, size: tuple[int, int], moments: list[list[object]]) -> None:
    """Put the engine, a page and a project with an exported scene into a folder."""
    width, height = size
    (scene,) = export.glob("*.tscn")
    files = {
        "project.godot": PROJECT.format(width=width, height=height).encode(),
        "main.tscn": MAIN.encode(),
        "main.gd": SCRIPT.format(moments=moments, scene=scene.name).encode(),
        scene.name: scene.read_bytes(),
    }
    for path in export.glob("*.png"):
        imported = f".godot/imported/{path.name}-0.ctex"
        files[f"{path.name}.import"] = (
            f'[remap]\n\nimporter="texture"\ntype="CompressedTexture2D"\npath="res://{imported}"\n'.encode()
        )
        files[imported] = texture(path)
    (folder / "client.pck").write_bytes(pack(files))
    (folder / "index.html").write_text(PAGE.format(width=width, height=height))
    for path in engine.glob("index.*"):
        if path.suffix in (".js", ".wasm") or ".worklet" in path.name:
            (folder / path.name).symlink_to(path)


def pack(files: dict[str, bytes]) -> bytes:
    """Write Godot's pack format, version 2."""
    entries, body, place = io.BytesIO(), io.BytesIO(), 0
    for name, data in files.items():
        path = f"res://{name}".encode()
        path += b"\0" * (-len(path) % 4)
        entries.write(struct.pack("<I", len(path)) + path)
        entries.write(struct.pack("<QQ", place, len(data)) + hashlib.md5(data).digest() + struct.pack("<I", 0))
        data += b"\0" * (-len(data) % ALIGN)
        body.write(data)
        place += len(data)
    head = 4 + 4 * 4 + 4 + 8 + 16 * 4 + 4 + len(entries.getvalue())
    base = head + (-head % ALIGN)
    start = PCK + struct.pack("<IIII", PCK_VERSION, 4, 3, 0) + struct.pack("<IQ", 0, base) + b"\0" * 64
    listed = start + struct.pack("<I", len(files)) + entries.getvalue()
    return listed + b"\0" * (base - len(listed)) + body.getvalue()


def texture(path: Path) -> bytes:
    """Write a picture as Godot imports it: CompressedTexture2D, lossless, with a PNG inside."""
    image = Image.open(path).convert("RGBA")
    png = io.BytesIO(b"PNG ")
    png.seek(4)
    image.save(png, format="PNG")
    width, height = image.size
    head = b"GST2" + struct.pack("<IIIIi", 1, width, height, 0, -1) + b"\0" * 12
    inside = struct.pack("<IHHII", PNG_INSIDE, width, height, 0, RGBA8)
    return head + inside + struct.pack("<I", len(png.getvalue())) + png.getvalue()
