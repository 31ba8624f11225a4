// Runs code of the documentation with Babylon.js, and answers with pictures.
//
// The question is {code, file, side, views: [{eye, target, fov}], settings}, as in three.js beside this file. `places`:
// rows of matrices of a forest; with `copies` in place of the code, a copy of the tree stands at each place. With `leftHanded` the
// scene is Babylon.js's usual one: the eyes are mirrored like the files. `samples`: true for multisampling. `background`: a
// color; without one it is transparent. The answer has for each view its `pixels`, the number of
// drawn `triangles`, the names of the `shown` levels, and the `counts` of a forest.
import { Color3, Color4, Engine, FreeCamera, HemisphericLight, Matrix, Quaternion, Scene, Vector3 } from "@babylonjs/core";
import { loadTree } from "leafcloud-babylon";

/** Runs a module's text and returns its `forest`, or else its `tree`. */
async function madeBy(code, given) {
  Object.assign(globalThis, given);
  const name = code.includes("const forest") ? "forest" : "tree";
  const text = `${code}\nexport { ${name} };`;
  return (await import(URL.createObjectURL(new Blob([text], { type: "text/javascript" }))))[name];
}

async function copiesOf(url, { scene, places }) {
  const tree = await loadTree(url, scene);
  tree.root.setEnabled(false);
  return places.map((place) => {
    const copy = tree.clone();
    copy.root.rotationQuaternion = new Quaternion();
    place.decompose(copy.root.scaling, copy.root.rotationQuaternion, copy.root.position);
    return copy;
  });
}

function newScene(engine, leftHanded, background) {
  const scene = new Scene(engine);
  scene.useRightHandedSystem = !leftHanded;
  const clear = background === undefined ? "#00000000" : `#${background.toString(16).padStart(6, "0")}ff`;
  scene.clearColor = Color4.FromHexString(clear);
  // Light from all sides.
  const light = new HemisphericLight("light", Vector3.Up(), scene);
  light.groundColor = Color3.White();
  light.intensity = 1; // Babylon.js leaves out the π.
  light.specular = Color3.Black();
  return scene;
}

function look(camera, { eye, target, fov }) {
  const [from, to] = [eye, target].map(([x, y, z]) => new Vector3(camera.getScene().useRightHandedSystem ? x : -x, y, z));
  camera.position = from;
  camera.setTarget(to);
  camera.fov = (fov * Math.PI) / 180;
  const away = Vector3.Distance(from, to);
  Object.assign(camera, { minZ: away / 100, maxZ: 100 * away });
}

function encoded(pixels) {
  let text = "";
  for (let i = 0; i < pixels.length; i += 1 << 15) text += String.fromCharCode(...pixels.subarray(i, i + (1 << 15)));
  return btoa(text);
}

async function answerTo(question) {
  const { code, file, side, views, settings = {}, leftHanded = false, places = [], copies = false, samples = false } = question;
  const canvas = document.querySelector("#canvas");
  Object.assign(canvas, { width: side, height: side });
  const engine = new Engine(canvas, samples, { preserveDrawingBuffer: true, premultipliedAlpha: false, alpha: true }, false);
  const scene = newScene(engine, leftHanded, question.background);
  const camera = new FreeCamera("camera", Vector3.Zero(), scene);
  const given = { scene, places: places.map((rows) => Matrix.FromArray(rows).transpose()) };
  const made = copies ? await copiesOf(file, given) : [await madeBy(code.replaceAll("pine.glb", file), given)];
  made.forEach((each) => Object.assign(each.settings, settings));
  await scene.whenReadyAsync();
  const pictures = [];
  for (const view of views) {
    look(camera, view);
    // Effects of materials that were not shown before are compiled meanwhile.
    for (let frame = 0; frame < 100; frame++) {
      scene.render();
      const waits = scene.getActiveMeshes().data.slice(0, scene.getActiveMeshes().length).some((mesh) => !mesh.isReady(true));
      if (!waits && frame > 1) break;
      await new Promise((done) => setTimeout(done, 20));
    }
    scene.render();
    const shown = scene.meshes.filter((mesh) => mesh.isEnabled() && mesh.getTotalVertices()).map((mesh) => mesh.name);
    const pixels = await engine.readPixels(0, 0, side, side);
    const drawn = { triangles: scene.getActiveIndices() / 3, shown, counts: made[0].counts };
    pictures.push({ pixels: encoded(new Uint8Array(pixels.buffer)), ...drawn });
  }
  return pictures;
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  await answer({ pictures: await answerTo(await (await fetch("/question")).json()) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
