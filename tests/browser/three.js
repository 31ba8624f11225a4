// Runs code of the documentation with three.js, and answers with pictures.
//
// The question is {code, files, side, views: [{eye, target, fov}], seconds, places, copies}. `code`: a module's text that
// uses `renderer`, `scene`, `camera` and `places`, and loads "pine.glb", for which `file` is read. Each of `views` gives a
// picture of `side` × `side` bytes RGBA, lowest row first, the number of drawn triangles and the milliseconds of the second drawing. `places`: rows of matrices of a
// forest. With `copies` in place of the code, a copy of the tree stands at each place.
import * as THREE from "three";
import { Tree } from "leafcloud-three";

function newRenderer(side) {
  const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
  renderer.setPixelRatio(1);
  renderer.setSize(side, side);
  renderer.setClearColor(0x000000, 0);
  renderer.debug.onShaderError = (context, program, vertex, fragment) => {
    throw new Error([vertex, fragment].map((shader) => context.getShaderInfoLog(shader)).join("\n"));
  };
  return renderer;
}

function pixelsOf(renderer, side) {
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * side * side);
  gl.readPixels(0, 0, side, side, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
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

async function answerTo({ code, file, side, views, seconds = 0, places = [], copies = false, settings = {} }) {
  const renderer = newRenderer(side);
  const scene = new THREE.Scene().add(new THREE.AmbientLight(0xffffff, Math.PI));
  const camera = new THREE.PerspectiveCamera(50, 1);
  const given = { THREE, renderer, scene, camera, places: places.map((rows) => new THREE.Matrix4().set(...rows)) };
  const loop = copies ? await copiesOf(file, given) : await loopOf(code.replaceAll("pine.glb", file), given);
  scene.children.forEach((object) => object.settings && Object.assign(object.settings, settings));
  return views.map(({ eye, target, fov }) => {
    camera.position.fromArray(eye);
    camera.lookAt(...target);
    const away = camera.position.distanceTo(new THREE.Vector3(...target));
    Object.assign(camera, { fov, near: away / 100, far: 100 * away });
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    loop(1000 * seconds);
    pixelsOf(renderer, 1);
    const begin = performance.now();
    loop(1000 * seconds);
    pixelsOf(renderer, 1); // Waits until the picture is done.
    const milliseconds = performance.now() - begin;
    return { milliseconds, pixels: pixelsOf(renderer, side), triangles: renderer.info.render.triangles, calls: renderer.info.render.calls };
  });
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  await answer({ pictures: await answerTo(await (await fetch("/question")).json()) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
