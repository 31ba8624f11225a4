// Times three.js drawing a level of a tree, as the viewer draws it.
//
// The question is {tree, size, distance, fieldOfView, rounds, cases: [level]}: the file, the picture's side in pixels,
// the camera's distance in radii, its field of view in degrees, and for each case the only level drawn. The answer
// {times: [[…]]} has for each case the milliseconds of every round. Cases take turns, so that other load on the machine
// affects all of them. A picture is done when a pixel of it was read.
import * as THREE from "three";
import { Tree } from "/engines/three/src/index.js";

const WARM_UP = 2;

function prepared(tree, distance, fieldOfView) {
  const scene = new THREE.Scene();
  const sun = new THREE.DirectionalLight(0xfff4e0, 2.5);
  sun.position.set(2, 3, 1);
  scene.add(tree, new THREE.HemisphereLight(0xdcecff, 0x6a6a50, 2), sun);
  const camera = new THREE.PerspectiveCamera(fieldOfView, 1, tree.radius / 10, (distance + 2) * tree.radius);
  camera.position.copy(tree.centre).addScaledVector(new THREE.Vector3(0.5, 0.15, 1).normalize(), distance * tree.radius);
  camera.lookAt(tree.centre);
  return { scene, camera };
}

/** Shows only this level, at rest. */
function show(tree, camera, level) {
  tree.settings.byHand = { transition: 0, keep: 1 };
  tree.update(camera);
  tree.levels.forEach(({ object }, number) => (object.visible = number === level));
}

function drawn(renderer, scene, camera) {
  const gl = renderer.getContext();
  const begin = performance.now();
  renderer.render(scene, camera);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  return performance.now() - begin;
}

async function times({ tree: url, size, distance, fieldOfView, rounds, cases }) {
  const renderer = new THREE.WebGLRenderer({ antialias: false });
  renderer.setPixelRatio(1);
  renderer.setSize(size, size);
  const tree = await Tree.load(url);
  const { scene, camera } = prepared(tree, distance, fieldOfView);
  const found = cases.map(() => []);
  for (let round = -WARM_UP; round < rounds; round++) {
    cases.forEach((each, i) => {
      show(tree, camera, each);
      const time = drawn(renderer, scene, camera);
      if (round >= 0) found[i].push(time);
    });
  }
  return found;
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  const question = await (await fetch("/question")).json();
  await answer({ times: await times(question) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
