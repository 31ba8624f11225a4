// Renders GLB files with three.js, unlit, and posts the results.
//
// The question is a JSON list of requests {url, ktx2, mips, trunk, sizes}. ktx2: use the textures of
// KHR_texture_basisu. mips: use their mip levels. trunk: show the trunk. sizes: {size: grid}, the picture's side in
// pixels and the number of subpixel offsets, grid × grid. The bounding sphere of the first model frames all pictures.
//
// The answer has for each request the number of texels along the frame's side. For each size and view it has the
// covered fraction of the picture and the mean linear RGB over the picture, and for the first view also the picture.
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
async function load({ url, ktx2, mips, trunk }) {
  const loader = new GLTFLoader();
  // Without a KTX2 loader three.js uses the PNG, like any engine without the extension.
  if (ktx2) loader.setKTX2Loader(new KTX2Loader().setTranscoderPath(TRANSCODER).detectSupport(renderer));
  const { scene, parser } = await loader.loadAsync(url);
  if (!trunk) meshes(scene).filter((mesh) => isTrunk(mesh, parser)).forEach((mesh) => mesh.removeFromParent());
  for (const mesh of meshes(scene)) {
    mesh.material = unlit(mesh.material);
    // Nothing moves here, and morph targets are slow in software.
    mesh.geometry.morphAttributes = {};
    const { map } = mesh.material;
    if (!map) continue;
    if (!trunk && map.mipmaps.length > 0 !== ktx2) throw new Error(`${url}: ${ktx2 ? "no" : "a"} KTX2 texture`);
    if (!mips) map.minFilter = THREE.LinearFilter;
  }
  scene.updateMatrixWorld(true);
  return scene;
}

function meshes(scene) {
  const found = [];
  scene.traverse((object) => object.isMesh && found.push(object));
  return found;
}

/** Returns whether a mesh is a trunk: its primitives follow those of the leaves. */
function isTrunk(mesh, parser) {
  const { meshes, primitives } = parser.associations.get(mesh);
  return primitives >= (parser.json.meshes[meshes].extras?.leafcloud?.first_trunk_primitive ?? Infinity);
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

/** Returns texels per unit of length, the mean over all edges: a level has one density. Null without textures. */
function density(scene) {
  let texels = 0;
  let length = 0;
  for (const mesh of meshes(scene)) {
    const { map } = mesh.material;
    if (!map) return null;
    const { uv } = mesh.geometry.attributes;
    const { width, height } = map.image;
    const points = corners(mesh);
    const { array } = mesh.geometry.index;
    for (let i = 0; i < array.length; i += 3) {
      const [a, b] = array.subarray(i, i + 2);
      texels += Math.hypot((uv.getX(b) - uv.getX(a)) * width, (uv.getY(b) - uv.getY(a)) * height);
      length += points[a].distanceTo(points[b]);
    }
  }
  return texels / length;
}

function cameraAt(direction, { center, radius }) {
  const camera = new THREE.OrthographicCamera(-radius, radius, radius, -radius, radius, 3 * radius);
  camera.position.copy(center).addScaledVector(direction, 2 * radius);
  camera.lookAt(center);
  return camera;
}

/** Returns the mean of grid × grid pictures with subpixel offsets. Mip levels stay those of this size. */
function picture(scene, camera, size, grid) {
  const target = new THREE.WebGLRenderTarget(size, size, { type: THREE.FloatType });
  const mean = new Float32Array(4 * size * size);
  const pixels = new Float32Array(mean.length);
  renderer.setRenderTarget(target);
  for (let place = 0; place < grid * grid; place++) {
    const offset = (i) => (i + 0.5) / grid - 0.5;
    camera.setViewOffset(size, size, offset(place % grid), offset(Math.floor(place / grid)), size, size);
    renderer.render(scene, camera);
    renderer.readRenderTargetPixels(target, 0, 0, size, size, pixels);
    for (let i = 0; i < mean.length; i++) mean[i] += pixels[i] / (grid * grid);
  }
  target.dispose();
  return mean;
}

/** Returns the means of red, green, blue and coverage. */
function means(pixels) {
  const sums = [0, 0, 0, 0];
  pixels.forEach((value, i) => (sums[i % 4] += value));
  return sums.map((sum) => (4 * sum) / pixels.length);
}

function encoded(floats) {
  const bytes = new Uint8Array(floats.buffer);
  let text = "";
  for (let i = 0; i < bytes.length; i += 1 << 15) text += String.fromCharCode(...bytes.subarray(i, i + (1 << 15)));
  return btoa(text);
}

function look(scene, sphere, sizes) {
  const cameras = directions().map((direction) => cameraAt(direction, sphere));
  return Object.entries(sizes).map(([size, grid]) => {
    const pictures = cameras.map((camera) => picture(scene, camera, Number(size), grid));
    return { size: Number(size), views: pictures.map(means), picture: encoded(pictures[0]) };
  });
}

async function seen(looks) {
  let sphere = null;
  const answers = [];
  for (const wanted of looks) {
    const scene = await load(wanted);
    sphere ??= boundingSphere(scene);
    const perLength = density(scene);
    answers.push({ texels: perLength && perLength * 2 * sphere.radius, sizes: look(scene, sphere, wanted.sizes) });
  }
  return answers;
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  const looks = await (await fetch("/question")).json();
  await answer({ seen: await seen(looks) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
