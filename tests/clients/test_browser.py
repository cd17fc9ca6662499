"""Chromium shows our exports: WebM with transparency in a video element, GLB by three.js in WebGL."""

import base64
import io
import shutil

import numpy as np
import pytest
from PIL import Image

from tests.clients.browser import page
from tests.export.moving import BEHIND, FILM, NUM_FRAMES, moving
from tests.node.client import HERE as NODE
from tests.node.client import require
from wildpuppet.export.draw import Painter
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of

pytestmark = pytest.mark.clients

VIDEO = """<!doctype html><body><script>
const video = document.createElement('video');
const canvas = document.createElement('canvas');
video.muted = true;
fetch('combined.webm').then((answer) => answer.blob()).then((blob) => { video.src = URL.createObjectURL(blob); });
const pictures = [];
const times = TIMES;
video.onloadeddata = () => { canvas.width = video.videoWidth; canvas.height = video.videoHeight; next(); };
video.onerror = () => end({ error: video.error.message });
function end(value) { fetch('/', { method: 'POST', body: JSON.stringify(value) }); }
function next() {
  if (pictures.length === times.length) { end({ pictures, duration: video.duration }); return; }
  video.onseeked = () => {
    const pen = canvas.getContext('2d');
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(video, 0, 0);
    pictures.push(canvas.toDataURL('image/png').split(',')[1]);
    next();
  };
  video.currentTime = times[pictures.length];
}
</script></body>"""

SCENE = """<!doctype html><body><script type="importmap">
{"imports": {"three": "./three/build/three.module.js", "three/addons/": "./three/examples/jsm/"}}
</script><script type="module">
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
const end = (value) => fetch('/', { method: 'POST', body: JSON.stringify(value) });
try {
  const gltf = await new GLTFLoader().loadAsync('puppet.glb');
  const renderer = new THREE.WebGLRenderer({ alpha: true, preserveDrawingBuffer: true });
  renderer.setSize(WIDTH, HEIGHT);
  const mixer = new THREE.AnimationMixer(gltf.scene);
  gltf.animations.forEach((clip) => mixer.clipAction(clip).play());
  const pictures = TIMES.map((time) => {
    mixer.setTime(time);
    renderer.render(gltf.scene, gltf.cameras[0]);
    return renderer.domElement.toDataURL('image/png').split(',')[1];
  });
  end({ pictures });
} catch (error) {
  end({ error: String(error) });
}
</script></body>"""

SHOWN = (0, 3, BEHIND, NUM_FRAMES - 1)
TIMES = str([(t + 0.5) / float(FILM) for t in SHOWN])
EDGE_SHARE = 0.004
"""Share of pixels that may differ: WebGL's rules for mesh borders differ from ours by a pixel."""


@pytest.fixture(scope="module")
def world():
    return moving()


def shown(folder, name, text, tmp_path):
    (folder / name).write_text(text)
    found = page(folder, name, tmp_path / "profile")
    assert "error" not in found, found
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(each)))).astype(float) for each in found["pictures"]]


def assert_like(picture, ours, levels, share):
    assert picture.shape == ours.shape
    assert (np.abs(picture[..., 3] - ours[..., 3]) > 24).mean() < EDGE_SHARE
    inside = (ours[..., 3] == 255) & (picture[..., 3] > 250)
    assert inside.sum() > 1000
    assert (np.abs(picture - ours)[inside][:, :3].max(-1) > levels).mean() < share


def test_webm_is_transparent_in_a_video_element(tmp_path, world):
    folder = export(world.animation, format_of("webm"), tmp_path / "out")
    pictures = shown(folder, "index.html", VIDEO.replace("TIMES", TIMES), tmp_path)
    painter = Painter(world.animation)
    for t, picture in zip(SHOWN, pictures, strict=True):
        assert_like(picture, painter.picture(world.animation[t]).astype(float), 12, 0.1)  # chroma is 2 x 2


def test_glb_is_drawn_by_three_js(tmp_path, world):
    require("three")
    folder = export(world.animation, format_of("glb"), tmp_path / "out")
    for part in ("build", "examples/jsm"):
        shutil.copytree(NODE / "node_modules" / "three" / part, folder / "three" / part)
    width, height = world.animation.size
    text = SCENE.replace("TIMES", TIMES).replace("WIDTH", str(width)).replace("HEIGHT", str(height))
    pictures = shown(folder, "index.html", text, tmp_path)
    painter = Painter(world.animation)
    for t, picture in zip(SHOWN, pictures, strict=True):
        assert_like(picture, painter.picture(world.animation[t]).astype(float), 3, 0.02)
