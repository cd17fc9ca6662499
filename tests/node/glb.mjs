// Validate a GLB with Khronos's validator and play it with three.js: node glb.mjs FILE.glb SECONDS...
// Prints {"issues", "times": [{mesh name: [[x, y, z], ...] of the shown meshes}], "materials", "duration"}.
import { readFileSync } from 'node:fs';
import validator from 'gltf-validator';
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

const [file, ...seconds] = process.argv.slice(2);
const bytes = readFileSync(file);
const report = await validator.validateBytes(new Uint8Array(bytes));

const loader = new GLTFLoader();
loader.register(() => ({ name: 'no pictures here', loadTexture: async () => new THREE.Texture() }));
globalThis.ProgressEvent ??= class {};
const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const gltf = await loader.parseAsync(buffer, '');
const mixer = new THREE.AnimationMixer(gltf.scene);
for (const clip of gltf.animations) {
  const action = mixer.clipAction(clip);
  action.setLoop(THREE.LoopOnce);
  action.clampWhenFinished = true;
  action.play();
}

const materials = new Set();
const weights = [];
function shown() {
  const meshes = {};
  gltf.scene.updateMatrixWorld(true);
  gltf.scene.traverse((node) => {
    if (!node.isMesh || Math.abs(node.matrixWorld.determinant()) < 1e-12) return;
    materials.add(`${node.material.type} transparent ${node.material.transparent} sides ${node.material.side}`);
    weights.push(...(node.morphTargetInfluences ?? []));
    const points = [];
    for (let i = 0; i < node.geometry.attributes.position.count; i += 1) {
      const point = node.getVertexPosition(i, new THREE.Vector3()).applyMatrix4(node.matrixWorld);
      points.push(point.toArray());
    }
    meshes[node.name] = points;
  });
  return meshes;
}

const times = seconds.map((second) => {
  mixer.setTime(Number(second));
  return shown();
});
process.stdout.write(JSON.stringify({
  issues: report.issues,
  times,
  materials: [...materials],
  weights: [Math.min(0, ...weights), Math.max(0, ...weights)],
  duration: gltf.animations[0]?.duration ?? 0,
  cameras: gltf.cameras.map((camera) => [camera.left, camera.right, camera.top, camera.bottom, ...camera.getWorldPosition(new THREE.Vector3()).toArray()]),
}));
