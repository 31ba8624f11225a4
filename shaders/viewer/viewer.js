// The viewer page: a tree, an orbiting camera, a read-out, and the settings of leafcloud-three (engines/three).
//
// ?tree=URL opens a file on the server, &distance=D starts at that distance from its center, and &keep=λ with that
// fraction of its leaves. Any name in SETTINGS works in the same way.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import GUI from "three/addons/libs/lil-gui.module.min.js";
import { SETTINGS, Tree } from "leafcloud-three";

const FRONT = new THREE.Vector3(0.5, 0.15, 1);
const wanted = new URLSearchParams(location.search);
const readOut = document.querySelector("#read-out");
const message = document.querySelector("#message");

const renderer = new THREE.WebGLRenderer({ antialias: true });
const scene = new THREE.Scene();
// bake.py's switch distances are for a vertical field of view of 50° over 1080 pixels.
const camera = new THREE.PerspectiveCamera(50);
const controls = new OrbitControls(camera, renderer.domElement);
const controlPanel = new GUI({ title: "Leafcloud" });

const sun = new THREE.DirectionalLight(0xfff4e0, 2.5);
const ground = new THREE.Mesh(new THREE.CircleGeometry(1, 64), new THREE.MeshLambertMaterial({ color: 0x9aa583 }));
const light = { height: 50, direction: 30 };

/** Milliseconds for which a message stays beside a tree. */
const READING = 8000;

/** Width of a window in pixels, below which the panel begins closed. */
const NARROW = 600;

let tree = null;

/** Number of files that were opened. */
let opened = 0;

function prepare() {
  document.body.append(renderer.domElement);
  scene.background = new THREE.Color(0xdfe7ee);
  ground.rotation.x = -Math.PI / 2;
  ground.visible = false;
  scene.add(new THREE.HemisphereLight(0xdcecff, 0x6a6a50, 2), sun, ground);
  moveSun();
  if (innerWidth < NARROW) controlPanel.close();
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
    const loaded = await Tree.load(url, { renderer });
    if (number !== opened) return; // Another file was opened meanwhile.
    show(loaded);
    tell("");
  } catch (error) {
    console.error(error);
    if (number === opened) tell(wordsFor(error, name), READING);
  }
}

/** Shows a text, over the page or beside the tree, there for some `milliseconds`. */
function tell(words, milliseconds = 0) {
  message.textContent = words;
  message.classList.toggle("beside", tree !== null);
  if (tree && milliseconds) setTimeout(() => message.textContent === words && tell(""), milliseconds);
}

/** Returns the error of a file and its remedy in words. */
function wordsFor(error, name) {
  if (/_shadow\.glb$/i.test(name)) return `${name} is the shadow proxy of a tree. Open the file without “_shadow”.`;
  if (!/\.glb$/i.test(name)) return `${name} is no GLB file. Open a NAME.glb that Leafcloud wrote.`;
  if (/^No levels|^An older/.test(error.message)) return `${name}: ${error.message}`;
  if (/fetch|404|Failed to load/i.test(error.message)) return `${name} cannot be found. Check its address.`;
  return `${name} cannot be read: it is broken, or no GLB file. Bake the tree again.`;
}

function moveSun() {
  const [height, direction] = [light.height, light.direction].map(THREE.MathUtils.degToRad);
  sun.position.setFromSphericalCoords(1, Math.PI / 2 - height, direction);
}

function show(loaded) {
  tree?.removeFromParent();
  tree = loaded;
  scene.add(tree);
  for (const name of Object.keys(SETTINGS)) if (wanted.has(name)) tree.settings[name] = Number(wanted.get(name));
  const foot = new THREE.Box3().setFromObject(tree.levels[0].object).min.y;
  ground.position.set(tree.centre.x, foot, tree.centre.z);
  ground.scale.setScalar(6 * tree.radius);
  controls.target.copy(tree.centre);
  lookFrom(Number(wanted.get("distance")) || 2.6 * tree.radius, FRONT);
  const farthest = 4 * (tree.levels.at(-2)?.handOver ?? 10 * tree.radius);
  // LOD distance and high pictures move levels away.
  Object.assign(camera, { near: tree.radius / 100, far: 16 * farthest });
  camera.updateProjectionMatrix();
  fillPanel(farthest);
}

/** Moves the camera to `distance` from the target, by default in its current direction. */
function lookFrom(distance, direction = camera.position.clone().sub(controls.target)) {
  camera.position.copy(controls.target).addScaledVector(direction, distance / direction.length());
}

function openButton() {
  const input = document.createElement("input");
  Object.assign(input, { type: "file", accept: ".glb", onchange: () => openFile(input.files[0]) });
  controlPanel.add({ open: () => input.click() }, "open").name("Open …");
}

function fillPanel(farthest) {
  controlPanel.controllers.slice(1).forEach((controller) => controller.destroy());
  controlPanel.folders.slice().forEach((folder) => folder.destroy());
  addDistance(farthest);
  addLevels();
  addScene();
  addPruning(farthest);
  addByHand();
  if (tree.levels[0].wind) addWind();
  const fades = controlPanel.addFolder("Fades").close();
  fades.add(tree.settings, "fadeBehindMorph", 0, 0.5).name("into clouds");
  fades.add(tree.settings, "fade", 0, 0.5).name("into the last level");
  fades.add(tree.settings, "hysteresis", 0, 0.2).name("delay on the way back");
}

function addLevels() {
  const byDistance = "for the distance";
  const state = { level: tree.settings.level ?? byDistance };
  const names = [byDistance, ...tree.levels.map((_, number) => number)];
  const apply = (level) => (tree.settings.level = level === byDistance ? null : level);
  controlPanel.add(state, "level", names).name("level").onChange(apply);
  controlPanel.add(tree.settings, "lodDistance", 0.25, 4).name("LOD distance");
}

function addScene() {
  const folder = controlPanel.addFolder("Scene").close();
  folder.add(ground, "visible").name("ground");
  folder.add(light, "height", 0, 90).name("sun height (°)").onChange(moveSun);
  folder.add(light, "direction", 0, 360).name("sun direction (°)").onChange(moveSun);
}

/** The slider is logarithmic, in doublings of the crown radius, so that near and far are equally easy to set. */
function addDistance(farthest) {
  const state = {
    get distance() {
      return Math.log2(tree.distance / tree.radius);
    },
    set distance(doublings) {
      lookFrom(tree.radius * 2 ** doublings);
    },
  };
  controlPanel.add(state, "distance", 0, Math.log2(farthest / tree.radius)).name("distance (doublings)").decimals(2).listen();
}

function addPruning(farthest) {
  const { settings } = tree;
  const byHand = Number.isFinite(settings.pruneStart);
  const [asBaked, never, fromHere] = ["as baked", "never", "from this distance"];
  const unpruned = settings.pruneStart === null ? asBaked : never;
  const state = { prune: byHand ? fromHere : unpruned, start: byHand ? settings.pruneStart : tree.levels[0].handOver / 4 };
  const starts = { [asBaked]: () => null, [never]: () => Infinity, [fromHere]: () => state.start };
  const apply = () => (settings.pruneStart = starts[state.prune]());
  const folder = controlPanel.addFolder("Fewer leaves with distance").close();
  folder.add(state, "prune", Object.keys(starts)).name("begin").onChange(apply);
  folder.add(state, "start", tree.radius, farthest / 4).name("this distance").onChange(apply);
  folder.add(settings, "pruneHalf", 0.01, 0.5).name("half of them at (share)").onChange(apply);
  folder.add(settings, "contrast").name("keep the contrast");
}

function addByHand() {
  const values = { transition: 0, keep: Number(wanted.get("keep")) || 1 };
  const state = { on: wanted.has("keep") };
  const apply = () => (tree.settings.byHand = state.on ? values : null);
  const folder = controlPanel.addFolder("By hand").close();
  folder.add(state, "on").name("ignore distance").onChange(apply);
  folder.add(values, "transition", 0, 1).name("onto billboards (a)");
  folder.add(values, "keep", 0.005, 1).name("kept leaves (λ)");
  apply();
}

/** Starts at the strength in the file unless the settings have one. */
function addWind() {
  const state = { strength: tree.settings.wind ?? tree.levels[0].wind.strength };
  const folder = controlPanel.addFolder("Wind").close();
  folder.add(state, "strength", 0, 20).onChange((strength) => (tree.settings.wind = strength));
}

function draw(milliseconds) {
  controls.update();
  if (tree && !wanted.has("pixels")) tree.settings.pixels = renderer.domElement.height;
  tree?.update(camera, milliseconds / 1000);
  renderer.render(scene, camera);
  if (!tree) return;
  const { level, transition, keep } = tree.state;
  const figures = {
    distance: `${tree.distance.toPrecision(4)}  (${(tree.distance / tree.radius).toFixed(1)} R)`,
    level: `${level} of ${tree.levels.length - 1}`,
    "transition a": transition.toFixed(3),
    "kept leaves λ": keep.toFixed(3),
    triangles: renderer.info.render.triangles.toLocaleString("en"),
    "draw calls": renderer.info.render.calls,
  };
  readOut.hidden = false;
  readOut.textContent = Object.entries(figures)
    .map(([name, figure]) => `${name.padEnd(14)}${figure}`)
    .join("\n");
}

prepare();
openButton();
renderer.setAnimationLoop(draw);
if (wanted.has("tree")) await open(wanted.get("tree"), wanted.get("tree"));
