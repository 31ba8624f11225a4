// Renders GLB files with three.js, unlit, and posts their coverage.
//
// The question is a JSON list of requests {url, ktx2, mips, sizes}. ktx2: use the textures of KHR_texture_basisu. mips:
// use their mip levels. sizes: pairs of the picture's side in pixels and the number of subpixel offsets along a pixel's
// side. The bounding sphere of the first model frames all pictures.
//
// The answer {coverages} has for each request and size the covered fraction of the picture in each view.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { KTX2Loader } from "three/addons/loaders/KTX2Loader.js";

const VIEWS = 8;
const TRANSCODER = "/engines/three/node_modules/three/examples/jsm/libs/basis/";

const renderer = new THREE.WebGLRenderer({ antialias: false });
renderer.setClearColor(0x000000, 0);

/** Returns directions on a spiral over the upper three quarters of the sphere: trees are rarely seen from below. */
function directions() {
  return Array.from({ length: VIEWS }, (_, i) => {
    const up = 1 - (1.5 * (i + 0.5)) / VIEWS;
    const radius = Math.sqrt(1 - up * up);
    const angle = i * Math.PI * (3 - Math.sqrt(5));
    return new THREE.Vector3(radius * Math.cos(angle), up, radius * Math.sin(angle));
  });
}

/** Loads a file's scene with unlit materials. */
async function load({ url, ktx2, mips }) {
  const loader = new GLTFLoader();
  // Without a KTX2 loader three.js uses the PNG, like any engine without the extension.
  if (ktx2) loader.setKTX2Loader(new KTX2Loader().setTranscoderPath(TRANSCODER).detectSupport(renderer));
  const { scene } = await loader.loadAsync(url);
  for (const mesh of meshes(scene)) {
    mesh.material = unlit(mesh.material);
    // Nothing moves here, and morph targets are slow in software.
    mesh.geometry.morphAttributes = {};
    const { map } = mesh.material;
    if (map && !mips) map.minFilter = THREE.LinearFilter;
  }
  scene.updateMatrixWorld(true);
  return scene;
}

function meshes(scene) {
  const found = [];
  scene.traverse((object) => object.isMesh && found.push(object));
  return found;
}

function unlit({ map, color, vertexColors, alphaTest, side }) {
  return new THREE.MeshBasicMaterial({ map, color, vertexColors, alphaTest, side });
}

function corners({ geometry, matrixWorld }) {
  const { position } = geometry.attributes;
  const corner = (_, i) => new THREE.Vector3().fromBufferAttribute(position, i).applyMatrix4(matrixWorld);
  return Array.from({ length: position.count }, corner);
}

function boundingSphere(scene) {
  const points = meshes(scene).flatMap(corners);
  const centre = new THREE.Box3().setFromPoints(points).getCenter(new THREE.Vector3());
  const radius = points.reduce((far, point) => Math.max(far, point.distanceTo(centre)), 0);
  return new THREE.Sphere(centre, radius);
}

function cameraAt(direction, { center, radius }) {
  const camera = new THREE.OrthographicCamera(-radius, radius, radius, -radius, radius, 3 * radius);
  camera.position.copy(center).addScaledVector(direction, 2 * radius);
  camera.lookAt(center);
  return camera;
}

/** Returns the mean alpha of grid × grid pictures with subpixel offsets. Mip levels stay those of this size. */
function covered(scene, camera, size, grid) {
  const target = new THREE.WebGLRenderTarget(size, size, { type: THREE.FloatType });
  const pixels = new Float32Array(4 * size * size);
  let sum = 0;
  renderer.setRenderTarget(target);
  for (let place = 0; place < grid * grid; place++) {
    const offset = (i) => (i + 0.5) / grid - 0.5;
    camera.setViewOffset(size, size, offset(place % grid), offset(Math.floor(place / grid)), size, size);
    renderer.render(scene, camera);
    renderer.readRenderTargetPixels(target, 0, 0, size, size, pixels);
    for (let i = 3; i < pixels.length; i += 4) sum += pixels[i];
  }
  target.dispose();
  return sum / (grid * grid * size * size);
}

async function coverages(requests) {
  let sphere = null;
  const found = [];
  for (const request of requests) {
    const scene = await load(request);
    sphere ??= boundingSphere(scene);
    const cameras = directions().map((direction) => cameraAt(direction, sphere));
    found.push(request.sizes.map(([size, grid]) => cameras.map((camera) => covered(scene, camera, size, grid))));
  }
  return found;
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  const requests = await (await fetch("/question")).json();
  await answer({ coverages: await coverages(requests) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
