// Times three.js drawing a forest, as a game would: the levels switch by themselves.
//
// The question is {tree, count, size, pictures, views: [{above, behind}], ways: [settings]}: the file, the number of trees, the
// picture's width and height in pixels, the pictures to time, the places of the eye above and behind the first tree, and for
// each way the settings of the forest. Distances are in crown radii. The answer is {renderer, times}: who draws, and for each
// view and way {frame, card, triangles}. `frame`: the median of the milliseconds of a picture, until a pixel of it was read;
// `card`: the median of those that the renderer reports, or null; `triangles`: those drawn. Ways take turns, so that other load
// on the machine affects all of them.
import * as THREE from "three";
import { Forest, LeafcloudLoader } from "/engines/three/src/index.js";

const WARM_UP = 1;
/** Crown radii from tree to tree, and from the first tree to the point in the middle of the picture. */
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

function sceneOf(forest) {
  const sun = new THREE.DirectionalLight(0xfff4e0, 2.5);
  sun.position.set(2, 3, 1);
  return new THREE.Scene().add(forest, new THREE.HemisphereLight(0xdcecff, 0x6a6a50, 2), sun);
}

function cameraFor({ centre, radius }, [width, height], { above, behind }) {
  const camera = new THREE.PerspectiveCamera(50, width / height, radius / 10, 1000 * radius);
  camera.position.copy(centre).add(new THREE.Vector3(0, above, behind).multiplyScalar(radius));
  camera.lookAt(centre.x, centre.y, centre.z - AHEAD * radius);
  return camera;
}

/** Settings with distances in the units of the forest. */
function inUnits(way, radius) {
  return way.pruneStart ? { ...way, pruneStart: way.pruneStart * radius } : way;
}

/** Draws one picture; returns its milliseconds and the query of the card's time. */
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
  return gl.getQueryParameter(query, gl.QUERY_RESULT) / 1e6;
}

function median(values) {
  return values.toSorted((a, b) => a - b)[Math.floor(values.length / 2)];
}

async function newForest(url, count, renderer) {
  const tree = await new LeafcloudLoader(renderer).loadAsync(url);
  return new Forest(tree, placesOf(count, tree.radius));
}

/** Draws all ways in turns; returns {frame, card, triangles} for each. */
async function timesOf(stage, ways, pictures, timer) {
  const { renderer, forest } = stage;
  const usual = { ...forest.settings };
  const found = ways.map(() => ({ frames: [], cards: [], triangles: 0 }));
  for (let round = -WARM_UP; round < pictures; round++) {
    for (const [i, way] of ways.entries()) {
      Object.assign(forest.settings, usual, inUnits(way, forest.radius));
      const { milliseconds, query } = drawn(stage, timer);
      const card = query && (await resultOf(renderer.getContext(), query));
      if (round < 0) continue;
      found[i].frames.push(milliseconds);
      if (query) found[i].cards.push(card);
      found[i].triangles = renderer.info.render.triangles;
    }
  }
  Object.assign(forest.settings, usual);
  return found.map(({ frames, cards, triangles }) => ({
    frame: median(frames),
    card: cards.length > 0 ? median(cards) : null,
    triangles,
  }));
}

async function answerTo({ tree, count, size, pictures, views, ways }) {
  const renderer = new THREE.WebGLRenderer({ antialias: false, powerPreference: "high-performance" });
  renderer.setPixelRatio(1);
  renderer.setSize(...size);
  const gl = renderer.getContext();
  const timer = gl.getExtension("EXT_disjoint_timer_query_webgl2");
  const forest = await newForest(tree, count, renderer);
  const scene = sceneOf(forest);
  const times = [];
  for (const view of views) {
    times.push(await timesOf({ renderer, forest, scene, camera: cameraFor(forest, size, view) }, ways, pictures, timer));
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
