// The viewer page: a tree or a forest, an orbiting camera, a read-out and a panel of settings.
//
// ?tree=URL opens a file on the server, &trees=N shows a forest, &beside=1 the full tree beside, &distance=D starts at that
// distance from its center, and &keep=λ with that fraction of its leaves. Any name of the package's settings works in the same way.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { SETTINGS } from "leafcloud-three";
import { fragmentsOf } from "./fragments.js";
import { fillPanel, newPanel } from "./panel.js";
import { load } from "./stand.js";

const FRONT = new THREE.Vector3(0.5, 0.15, 1);
const wanted = new URLSearchParams(location.search);
const readOut = document.querySelector("#read-out");
const message = document.querySelector("#message");

const renderer = new THREE.WebGLRenderer({ antialias: true });
const scene = new THREE.Scene();
// bake.py's switch distances are for a vertical field of view of 50° over 1080 pixels.
const camera = new THREE.PerspectiveCamera(50);
const controls = new OrbitControls(camera, renderer.domElement);

const sun = new THREE.DirectionalLight(0xfff4e0, 2.5);
const ground = new THREE.Mesh(new THREE.CircleGeometry(1, 64), new THREE.MeshLambertMaterial({ color: 0x9aa583 }));
const light = { height: 50, direction: 30 };
const page = { openFile, lookFrom, reachChanged, ground, light, moveSun, wanted };
const panel = newPanel(page);

/** Milliseconds for which a message stays beside a tree. */
const READING = 8000;

/** Width of a window in pixels, below which the panel begins closed. */
const NARROW = 600;

/** Pictures from one count of fragments to the next. */
const COUNTED = 30;

let stand = null;

/** Number of files that were opened. */
let opened = 0;

/** Pictures drawn, the fragments of the last count, and the milliseconds of a picture, smoothed. */
const drawn = { pictures: 0, fragments: 0, milliseconds: 0, at: 0 };

function prepare() {
  document.body.append(renderer.domElement);
  scene.background = new THREE.Color(0xdfe7ee);
  ground.rotation.x = -Math.PI / 2;
  ground.visible = false;
  scene.add(new THREE.HemisphereLight(0xdcecff, 0x6a6a50, 2), sun, ground);
  moveSun();
  if (innerWidth < NARROW) panel.close();
  window.addEventListener("resize", fit);
  window.addEventListener("dragover", (event) => event.preventDefault());
  window.addEventListener("drop", (event) => {
    event.preventDefault();
    openFile(event.dataTransfer.files[0]);
  });
  fit();
}

function fit() {
  renderer.setPixelRatio(devicePixelRatio);
  renderer.setSize(innerWidth, innerHeight);
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
}

async function openFile(file) {
  if (!file) return;
  const url = URL.createObjectURL(file);
  await open(url, file.name);
  URL.revokeObjectURL(url);
}

async function open(url, name) {
  const number = ++opened;
  tell(`Reading ${name} …`);
  try {
    const loaded = await load(url, renderer);
    if (number !== opened) return; // Another file was opened meanwhile.
    show(loaded);
    tell(wordsAbout(loaded.tree, name), READING);
  } catch (error) {
    console.error(error);
    if (number === opened) tell(wordsFor(error, name), READING);
  }
}

/** Shows words in the middle of an empty page, or beside the tree, there for a time if `milliseconds` is not 0. */
function tell(words, milliseconds = 0) {
  message.textContent = words;
  message.classList.toggle("beside", stand !== null);
  if (stand && milliseconds) setTimeout(() => message.textContent === words && tell(""), milliseconds);
}

/** Returns what a user should know of a file that was read. */
function wordsAbout({ levels, trees }, name) {
  if (levels.length === 0) return `${name} has no levels of Leafcloud. It is shown as it is.`;
  return trees > 1 ? `${name} has ${trees} trees. The first one is shown.` : "";
}

/** Returns the error of a file and its remedy in words. */
function wordsFor(error, name) {
  if (/_shadow\.glb$/i.test(name)) return `${name} is the shadow proxy of a tree. Open the file without “_shadow”.`;
  if (!/\.glb$/i.test(name)) return `${name} is no GLB file. Open a NAME.glb that Leafcloud wrote.`;
  if (/^No meshes|^An older/.test(error.message)) return `${name}: ${error.message}`;
  if (/fetch|404|Failed to load/i.test(error.message)) return `${name} cannot be found. Check its address.`;
  return `${name} cannot be read: it is broken, or no GLB file. Bake the tree again.`;
}

function moveSun() {
  const [height, direction] = [light.height, light.direction].map(THREE.MathUtils.degToRad);
  sun.position.setFromSphericalCoords(1, Math.PI / 2 - height, direction);
}

function show(loaded) {
  stand?.removeFromParent();
  stand?.dispose();
  stand = loaded;
  scene.add(stand);
  const { tree } = stand;
  for (const name of Object.keys(SETTINGS)) if (wanted.has(name)) tree.settings[name] = Number(wanted.get(name));
  if (tree.levels.length) Object.assign(stand, { count: Number(wanted.get("trees")) || 1, beside: wanted.has("beside") });
  const foot = new THREE.Box3().setFromObject(tree.levels[0]?.object ?? tree).min.y;
  ground.position.set(tree.centre.x, foot, tree.centre.z);
  reachChanged();
  lookFrom(Number(wanted.get("distance")) || (stand.beside ? 3.6 : 2.6) * tree.radius, FRONT);
  fillPanel(panel, stand, page, farthest());
}

/** Returns the farthest distance to look from. */
function farthest() {
  return Math.max(4 * (stand.tree.levels.at(-2)?.handOver ?? 10 * stand.tree.radius), 2 * stand.reach);
}

/** Fits ground and camera to one tree, two or the forest. The camera keeps its place relative to the middle. */
function reachChanged() {
  camera.position.add(stand.middle).sub(controls.target);
  controls.target.copy(stand.middle);
  ground.visible ||= stand.count > 1;
  ground.scale.setScalar(Math.max(6 * stand.tree.radius, 1.1 * stand.reach));
  // LOD distance and high pictures move levels away.
  Object.assign(camera, { near: stand.tree.radius / 100, far: Math.max(16 * farthest(), 4 * stand.reach) });
  camera.updateProjectionMatrix();
}

/** Moves the camera to `distance` from the target, by default in its current direction. */
function lookFrom(distance, direction = camera.position.clone().sub(controls.target)) {
  camera.position.copy(controls.target).addScaledVector(direction, distance / direction.length());
}

function draw(milliseconds) {
  controls.update();
  stand?.update(camera, milliseconds / 1000);
  renderer.render(scene, camera);
  if (!stand) return;
  measure(milliseconds);
  tellFigures();
}

/** Smooths the time from picture to picture, and counts fragments now and then. */
function measure(milliseconds) {
  const passed = milliseconds - drawn.at;
  drawn.milliseconds += (passed - drawn.milliseconds) * (drawn.pictures > 1 ? 0.1 : 1);
  drawn.at = milliseconds;
  drawn.triangles = renderer.info.render.triangles;
  drawn.calls = renderer.info.render.calls;
  if (drawn.pictures++ % COUNTED === 1) drawn.fragments = fragmentsOf(renderer, scene, camera);
}

function tellFigures() {
  const { tree, counts } = stand;
  const figures = { distance: `${tree.distance.toPrecision(4)}  (${(tree.distance / tree.radius).toFixed(1)} R)` };
  if (counts) figures["trees by level"] = counts.join(", ");
  else if (tree.levels.length) {
    const { level, transition, keep } = tree.state;
    figures.level = `${level} of ${tree.levels.length - 1}`;
    figures["onto billboards"] = transition.toFixed(3);
    figures["kept leaves"] = keep.toFixed(3);
  }
  figures.triangles = drawn.triangles.toLocaleString("en");
  figures.fragments = drawn.fragments.toLocaleString("en");
  figures["draw calls"] = drawn.calls;
  figures["ms a picture"] = drawn.milliseconds.toFixed(1);
  readOut.hidden = false;
  readOut.textContent = Object.entries(figures)
    .map(([name, figure]) => `${name.padEnd(16)}${figure}`)
    .join("\n");
}

prepare();
renderer.setAnimationLoop(draw);
if (wanted.has("tree")) await open(wanted.get("tree"), wanted.get("tree"));
