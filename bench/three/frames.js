// Times three.js drawing a forest, as a game would: the levels switch by themselves.
//
// The question is {count, size, pictures, views: [{above, before}], ways: [{tree, level}]}: the number of trees, the picture's
// width and height in pixels, the pictures to time, the places of the eye above and in front of the first row in crown radii, and
// for each way the file and the only level to draw, or null for the level for the distance. The answer is {renderer, times}:
// who draws, and for each view and way {frame, drawing, triangles}. `frame`: the median of the milliseconds of a picture, until a
// pixel of it was read; `drawing`: the median of those of the renderer alone, or null; `triangles`: those drawn. Ways take
// turns, so that other load on the machine affects all of them.
import * as THREE from "three";
import { Forest, LeafcloudLoader } from "/engines/three/src/index.js";

const WARM_UP = 1;
/** Crown radii from tree to tree, and from the middle tree of the first row to the point in the middle of the picture. */
const STEP = 2.6;
const AHEAD = 8.0;

/** Places of trees in a square in front of the camera. */
function placesOf(count, radius) {
  const side = Math.ceil(Math.sqrt(count));
  const step = STEP * radius;
  return Array.from({ length: count }, (_, i) => {
    const [column, row] = [i % side, Math.floor(i / side)];
    return new THREE.Matrix4().makeTranslation((column - Math.floor(side / 2)) * step, 0, -row * step);
  });
}

function sceneOf(forests) {
  const sun = new THREE.DirectionalLight(0xfff4e0, 2.5);
  sun.position.set(2, 3, 1);
  return new THREE.Scene().add(...forests, new THREE.HemisphereLight(0xdcecff, 0x6a6a50, 2), sun);
}

function cameraFor({ centre, radius }, [width, height], { above, before }) {
  const camera = new THREE.PerspectiveCamera(50, width / height, radius / 10, 1000 * radius);
  camera.position.copy(centre).add(new THREE.Vector3(0, above, before).multiplyScalar(radius));
  camera.lookAt(centre.x, centre.y, centre.z - AHEAD * radius);
  return camera;
}

/** Draws one picture; returns its milliseconds and the query of the time of drawing. */
function drawn({ renderer, scene, forest, camera }, timer) {
  const gl = renderer.getContext();
  const query = timer && gl.createQuery();
  const begin = performance.now();
  forest.update(camera);
  if (query) gl.beginQuery(timer.TIME_ELAPSED_EXT, query);
  renderer.render(scene, camera);
  if (query) gl.endQuery(timer.TIME_ELAPSED_EXT);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  return { milliseconds: performance.now() - begin, query };
}

/** Milliseconds of a query; results arrive only after the page has given control back. */
async function resultOf(gl, query) {
  while (!gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE)) await new Promise((resume) => setTimeout(resume, 1));
  const milliseconds = gl.getQueryParameter(query, gl.QUERY_RESULT) / 1e6;
  gl.deleteQuery(query);
  return milliseconds;
}

function median(values) {
  return values.toSorted((a, b) => a - b)[Math.floor(values.length / 2)];
}

async function newForest(url, count, renderer) {
  const tree = await new LeafcloudLoader(renderer).loadAsync(url);
  return new Forest(tree, placesOf(count, tree.radius));
}

/** Forests by file. */
async function forestsOf(ways, count, renderer) {
  const files = [...new Set(ways.map(({ tree }) => tree))];
  return new Map(await Promise.all(files.map(async (file) => [file, await newForest(file, count, renderer)])));
}

/** Draws all ways in turns; returns {frame, drawing, triangles} for each. */
async function timesOf({ renderer, scene, forests, camera }, ways, pictures, timer) {
  const found = ways.map(() => ({ frames: [], drawings: [], triangles: 0 }));
  for (let round = -WARM_UP; round < pictures; round++) {
    for (const [i, { tree, level }] of ways.entries()) {
      forests.forEach((each, file) => (each.visible = file === tree));
      const forest = forests.get(tree);
      forest.settings.level = level;
      const { milliseconds, query } = drawn({ renderer, scene, forest, camera }, timer);
      if (renderer.getContext().isContextLost()) throw new Error("the renderer lost its context");
      const drawing = query && (await resultOf(renderer.getContext(), query));
      if (round < 0) continue;
      found[i].frames.push(milliseconds);
      if (query) found[i].drawings.push(drawing);
      found[i].triangles = renderer.info.render.triangles;
    }
  }
  return found.map(({ frames, drawings, triangles }) => ({
    frame: median(frames),
    drawing: drawings.length > 0 ? median(drawings) : null,
    triangles,
  }));
}

async function answerTo({ count, size, pictures, views, ways }) {
  const renderer = new THREE.WebGLRenderer({ antialias: false, powerPreference: "high-performance" });
  renderer.setPixelRatio(1);
  renderer.setSize(...size);
  renderer.domElement.addEventListener("webglcontextlost", () => answer({ error: "the renderer lost its context" }));
  const gl = renderer.getContext();
  const timer = gl.getExtension("EXT_disjoint_timer_query_webgl2");
  const forests = await forestsOf(ways, count, renderer);
  const scene = sceneOf(forests.values());
  const times = [];
  for (const view of views) {
    const camera = cameraFor(forests.get(ways[0].tree), size, view);
    times.push(await timesOf({ renderer, scene, forests, camera }, ways, pictures, timer));
  }
  return { renderer: gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL), times };
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  const question = await (await fetch("/question")).json();
  await answer(await answerTo(question));
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
