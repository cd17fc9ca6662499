// Plays an exported skeleton in the DragonBones runtime and prints, as JSON, what stands where in every frame.
// Every STRIDEth frame of each animation, and the moments half a frame after them.
// node dragonbones.mjs FOLDER STEM STRIDE
import fs from "node:fs";
import path from "node:path";
import * as db from "@cocos/dragonbones-js";

console.log = console.info = console.error; // the runtime greets; only JSON goes to stdout
db.DragonBones.yDown = true; // as its runtimes for Pixi, Egret and Phaser set it

const [folder, stem, stride] = process.argv.slice(2);
const read = (name) => JSON.parse(fs.readFileSync(path.join(folder, name), "utf8"));

class Texture extends db.TextureData {
  static toString() {
    return "[class Texture]"; // the runtime pools objects by this
  }
}
class Atlas extends db.TextureAtlasData {
  static toString() {
    return "[class Atlas]";
  }
  createTexture() {
    return db.BaseObject.borrowObject(Texture);
  }
}
class Slot extends db.Slot {
  static toString() {
    return "[class Slot]";
  }
}
for (const name of ["_initDisplay", "_disposeDisplay", "_onUpdateDisplay", "_addDisplay", "_replaceDisplay",
  "_removeDisplay", "_updateZOrder", "_updateVisible", "_updateBlendMode", "_updateColor", "_updateFrame",
  "_updateMesh", "_updateGlueMesh", "_updateTransform", "_identityTransform"]) {
  Slot.prototype[name] = () => {};
}
const stub = () => ({
  dbInit() {}, dbClear() {}, dbUpdate() {}, dispose() {}, hasDBEventListener: () => false, dispatchDBEvent() {},
});
class Factory extends db.BaseFactory {
  constructor() {
    super();
    this._dragonBones = new db.DragonBones(stub());
  }
  _isSupportMesh() {
    return true;
  }
  _buildTextureAtlasData(atlas) {
    return atlas || db.BaseObject.borrowObject(Atlas);
  }
  _buildArmature(data) {
    const armature = db.BaseObject.borrowObject(db.Armature);
    const display = stub();
    armature.init(data.armature, display, display, this._dragonBones);
    return armature;
  }
  _buildSlot(_, data, armature) {
    const slot = db.BaseObject.borrowObject(Slot);
    slot.init(data, armature, {}, {});
    return slot;
  }
}

function meshOf(slot) {
  const deform = slot._deformVertices;
  const mesh = deform.verticesData;
  const ints = mesh.data.intArray;
  const floats = mesh.data.floatArray;
  const count = ints[mesh.offset];
  const start = ints[mesh.offset + 2] < 0 ? ints[mesh.offset + 2] + 65536 : ints[mesh.offset + 2];
  const region = slot._textureData.region;
  const vertices = [], uv = [];
  const map = slot.globalTransformMatrix;
  for (let i = 0; i < 2 * count; i += 2) {
    const x = floats[start + i] + (deform.vertices[i] || 0);
    const y = floats[start + i + 1] + (deform.vertices[i + 1] || 0);
    vertices.push([map.a * x + map.c * y + map.tx, map.b * x + map.d * y + map.ty]);
    uv.push([region.x + floats[start + 2 * count + i] * region.width,
      region.y + floats[start + 2 * count + i + 1] * region.height]);
  }
  const triangles = Array.from(ints.slice(mesh.offset + 4, mesh.offset + 4 + 3 * ints[mesh.offset + 1]));
  return { vertices, uv, triangles };
}

const factory = new Factory();
const skeleton = factory.parseDragonBonesData(read(`${stem}_ske.json`));
factory.parseTextureAtlasData(read(`${stem}_tex.json`), {});
const armature = factory.buildArmature(skeleton.armatureNames[0]);
const at = (name, seconds) => {
  armature.animation.gotoAndStopByTime(name, seconds);
  armature.advanceTime(0);
  for (const slot of armature.getSlots()) slot.updateGlobalTransform();
  const slots = armature.getSlots();
  return {
    order: slots.map((slot) => slot.name),
    shown: slots.map((slot) => slot.displayIndex >= 0),
    meshes: Object.fromEntries(slots.filter((slot) => slot.displayIndex >= 0).map((slot) => [slot.name, meshOf(slot)])),
    bones: Object.fromEntries(armature.getBones().map((bone) => {
      bone.updateGlobalTransform();
      const map = bone.globalTransformMatrix; // where it is and its x axis
      return [bone.name, [map.tx, map.ty, map.a, map.b]];
    })),
  };
};
const animations = armature.armatureData.animationNames.map((name) => {
  const data = armature.armatureData.getAnimation(name);
  const rate = armature.armatureData.frameRate;
  const frames = [...Array(data.frameCount).keys()].filter((frame) => frame % Number(stride) === 0);
  return {
    name, length: data.frameCount,
    frames: frames.map((frame) => at(name, (frame + 1e-6) / rate)),
    between: frames.map((frame) => at(name, (frame + 0.5) / rate)),
  };
});
process.stdout.write(JSON.stringify({ rate: armature.armatureData.frameRate, animations }));
