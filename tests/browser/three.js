// Runs code of the documentation with three.js, and answers with pictures.
//
// The question is {code, file, renderer, side, views, seconds, places, copies, settings, sun, mips, samples,
// background}. `code`: a module's text that uses
// `renderer`, `scene`, `camera` and `places`, and loads "pine.glb", for which `file` is read. `renderer`: "webgl" (the default)
// for WebGLRenderer, "webgl2" or "webgpu" for that backend of WebGPURenderer. Each of the `views` {eye, target, fov, settings,
// seconds} gives a picture of `side` × `side` bytes RGBA, lowest row first, and the number of drawn triangles
// and draw calls; its own settings and seconds replace the common ones. `places`: rows of matrices of a forest. With
// `copies` in place of the code, a copy of the tree stands at each place. `sun`: the position of a light that casts shadows,
// beside a dim one from everywhere. `mips`: false to draw cut-out PNG textures without mip levels. `samples`: true for multisampling.
// `background`: a color; without one it is transparent. Without views the answer is
// {lacking}: why the renderer cannot run here, or null.
import * as THREE from "three";
import { Tree } from "leafcloud-three";

const failures = [];

function newWebGLRenderer(antialias) {
  const renderer = new THREE.WebGLRenderer({ antialias, preserveDrawingBuffer: true });
  renderer.debug.onShaderError = (context, program, vertex, fragment) => {
    throw new Error([vertex, fragment].map((shader) => context.getShaderInfoLog(shader)).join("\n"));
  };
  return renderer;
}

async function newNodeRenderer(forceWebGL, side, antialias) {
  const { WebGPURenderer } = await import("three/webgpu");
  console.error = (...texts) => failures.push(texts.join(" ")); // three.js only logs errors of shaders.
  const renderer = new WebGPURenderer({ antialias, forceWebGL });
  // Without a display Chromium does not show a canvas of WebGPU.
  renderer.setOutputRenderTarget(new THREE.RenderTarget(side, side, { depthBuffer: false }));
  return renderer;
}

async function newRenderer({ renderer: kind = "webgl", side, samples = false, background }) {
  const renderer = kind === "webgl" ? newWebGLRenderer(samples) : await newNodeRenderer(kind === "webgl2", side, samples);
  renderer.setPixelRatio(1);
  renderer.setSize(side, side);
  renderer.setClearColor(background ?? 0x000000, background === undefined ? 0 : 1);
  return renderer;
}

/** Returns the bytes of the lower left square of the picture, the lowest row first. */
async function bytesOf(renderer, side) {
  if (!renderer.isWebGLRenderer) return nodeBytesOf(renderer, side);
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * side * side);
  gl.readPixels(0, 0, side, side, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return pixels;
}

/** The same by WebGPURenderer. Its WebGPU backend pads rows to 256 bytes, and counts them from above. */
async function nodeBytesOf(renderer, side) {
  const target = renderer.getOutputRenderTarget();
  const { isWebGPUBackend } = renderer.backend;
  const lowest = isWebGPUBackend ? target.height - side : 0;
  const bytes = await renderer.readRenderTargetPixelsAsync(target, 0, lowest, side, side);
  const stride = isWebGPUBackend ? Math.ceil((4 * side) / 256) * 256 : 4 * side;
  const rows = Array.from({ length: side }, (_, row) => bytes.slice(stride * row, stride * row + 4 * side));
  return Uint8Array.from((isWebGPUBackend ? rows.reverse() : rows).flatMap((row) => [...row]));
}

async function pixelsOf(renderer, side) {
  const pixels = await bytesOf(renderer, side);
  let text = "";
  for (let i = 0; i < pixels.length; i += 1 << 15) text += String.fromCharCode(...pixels.subarray(i, i + (1 << 15)));
  return btoa(text);
}

/** Runs a module's text and returns the function that it gave to setAnimationLoop. */
async function loopOf(code, given) {
  let loop = null;
  given.renderer.setAnimationLoop = (run) => (loop = run);
  Object.assign(globalThis, given);
  await import(URL.createObjectURL(new Blob([code], { type: "text/javascript" })));
  return loop;
}

async function copiesOf(url, { renderer, scene, camera, places }) {
  const tree = await Tree.load(url, { renderer });
  const copies = places.map((place) => {
    const copy = tree.clone();
    place.decompose(copy.position, copy.quaternion, copy.scale);
    return copy;
  });
  scene.add(...copies);
  return (time) => {
    copies.forEach((copy) => copy.update(camera, time / 1000));
    renderer.render(scene, camera);
  };
}

/** Returns the lights: one from everywhere, or a sun with shadows. */
function lightsOf(sun) {
  if (!sun) return [new THREE.AmbientLight(0xffffff, Math.PI)];
  const light = new THREE.DirectionalLight(0xffffff, Math.PI);
  light.position.fromArray(sun);
  light.castShadow = true;
  const far = 2 * light.position.length();
  Object.assign(light.shadow.camera, { left: -far / 4, right: far / 4, top: far / 4, bottom: -far / 4, far });
  light.shadow.mapSize.set(1024, 1024);
  return [light, new THREE.AmbientLight(0xffffff, 0.3)];
}

function castShadows(renderer, scene) {
  renderer.shadowMap.enabled = true;
  scene.traverse((object) => object.isMesh && Object.assign(object, { castShadow: true, receiveShadow: true }));
}

/** Takes the mip levels from cut-out PNG textures, before the first picture. */
function dropMips(scene) {
  scene.traverse(({ material }) => {
    const { map } = material ?? {};
    if (map?.mipmaps.length > 0 && !map.isCompressedTexture) {
      Object.assign(map, { mipmaps: [], minFilter: THREE.LinearFilter, generateMipmaps: false, needsUpdate: true });
    }
  });
}

async function lackingFor(kind) {
  return kind === "webgpu" && !(await navigator.gpu?.requestAdapter()) ? "Chromium has no adapter for WebGPU" : null;
}

async function answerTo(question) {
  const { code, file, side, views, seconds = 0, places = [], copies = false, settings = {}, sun, mips = true } = question;
  const renderer = await newRenderer(question);
  const scene = new THREE.Scene().add(...lightsOf(sun));
  const camera = new THREE.PerspectiveCamera(50, 1);
  const given = { THREE, renderer, scene, camera, places: places.map((rows) => new THREE.Matrix4().set(...rows)) };
  const loop = copies ? await copiesOf(file, given) : await loopOf(code.replaceAll("pine.glb", file), given);
  if (sun) castShadows(renderer, scene);
  if (!mips) dropMips(scene);
  const pictures = [];
  for (const { eye, target, fov, ...own } of views) {
    const now = 1000 * (own.seconds ?? seconds);
    scene.children.forEach((object) => object.settings && Object.assign(object.settings, settings, own.settings));
    camera.position.fromArray(eye);
    camera.lookAt(...target);
    const away = camera.position.distanceTo(new THREE.Vector3(...target));
    Object.assign(camera, { fov, near: away / 100, far: 100 * away });
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    loop(now);
    renderer.info.reset();
    loop(now);
    const { triangles, calls, drawCalls = calls } = renderer.info.render;
    pictures.push({ pixels: await pixelsOf(renderer, side), triangles, calls: drawCalls });
  }
  if (failures.length > 0) throw new Error(failures.join("\n"));
  return pictures;
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  const question = await (await fetch("/question")).json();
  if (question.views) await answer({ pictures: await answerTo(question) });
  else await answer({ lacking: await lackingFor(question.renderer) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
