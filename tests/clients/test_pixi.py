"""PixiJS draws a DragonBones export in Chromium with the published runtime: texture, alpha, order, bending.

The animation is played up to each moment: runtime 8.0.3 changes neither order nor visibility while it is stopped.
"""

import shutil

import pytest

from tests.clients.test_browser import assert_like, shown
from tests.export.moving import BEHIND, LOST, NUM_FRAMES, SHOT, moving
from tests.node.client import HERE as NODE
from tests.node.client import require
from wildpuppet.export.draw import Painter
from wildpuppet.export.export import export
from wildpuppet.export.formats import format_of

pytestmark = pytest.mark.clients

STAGE = """<!doctype html><body><script type="importmap">
{"imports": {"pixi.js": "./pixi.mjs", "dragonbones": "./runtime/index.mjs"}}
</script><script type="module">
import { Assets, WebGLRenderer, Container } from 'pixi.js';
import { PixiFactory } from 'dragonbones';
const end = (value) => fetch('/', { method: 'POST', body: JSON.stringify(value) });
try {
  const renderer = new WebGLRenderer();
  await renderer.init({ width: WIDTH, height: HEIGHT, backgroundAlpha: 0, antialias: false, resolution: 1,
    preserveDrawingBuffer: true });
  const read = async (name) => (await fetch(name)).json();
  const factory = PixiFactory.newInstance(false);
  factory.parseDragonBonesData(await read('hero_run_ske.json'));
  factory.parseTextureAtlasData(await read('hero_run_tex.json'), await Assets.load('hero_run_tex.png'));
  const puppet = factory.buildArmatureDisplay('hero_run');
  const stage = new Container();
  stage.addChild(puppet);
  const pictures = MOMENTS.map(([name, time]) => {
    puppet.animation.gotoAndPlayByTime(name, time, 1);
    puppet.armature.advanceTime(0);
    renderer.render(stage);
    return renderer.canvas.toDataURL('image/png').split(',')[1];
  });
  end({ pictures });
} catch (error) {
  end({ error: String(error) + error.stack });
}
</script></body>"""

FRAMES = (0, 3, LOST, BEHIND, NUM_FRAMES - 1)


def moment(t):
    """Animation and time of a frame; the rate is written as 24."""
    start, name = (SHOT, "hero run_shot2") if t >= SHOT else (0, "hero run_shot1")
    return [name, (t - start + 1e-4) / 24]


def test_pixi_draws_the_puppet(tmp_path):
    require("pixi.js")
    require("pixi-dragonbones-runtime")
    world = moving()
    folder = export(world.animation, format_of("dragonbones"), tmp_path / "out")
    shutil.copyfile(NODE / "node_modules" / "pixi.js" / "dist" / "pixi.min.mjs", folder / "pixi.mjs")
    shutil.copytree(NODE / "node_modules" / "pixi-dragonbones-runtime" / "lib", folder / "runtime")
    width, height = world.animation.size
    text = STAGE.replace("MOMENTS", str([moment(t) for t in FRAMES]))
    pictures = shown(folder, "index.html", text.replace("WIDTH", str(width)).replace("HEIGHT", str(height)), tmp_path)
    painter = Painter(world.animation)
    for t, picture in zip(FRAMES, pictures, strict=True):
        if t == LOST:
            assert not picture.any()
        else:
            assert_like(picture, painter.picture(world.animation[t]).astype(float), 3, 0.02)
