// The panel of settings. It is made anew for each file.
import GUI from "three/addons/libs/lil-gui.module.min.js";
import { COUNTS } from "./stand.js";

/** Returns the panel. `openFile` is called with the file that was chosen. */
export function newPanel({ openFile }) {
  const panel = new GUI({ title: "Leafcloud" });
  const input = document.createElement("input");
  Object.assign(input, { type: "file", accept: ".glb", onchange: () => openFile(input.files[0]) });
  panel.add({ open: () => input.click() }, "open").name("Open …");
  return panel;
}

/**
 * Fills the panel for a stand. `page`: the functions and things of the page that it changes. `farthest`: the farthest distance
 * to look from.
 */
export function fillPanel(panel, stand, page, farthest) {
  panel.controllers.slice(1).forEach((controller) => controller.destroy());
  panel.folders.slice().forEach((folder) => folder.destroy());
  const { tree } = stand;
  addDistance(panel, tree, page, farthest);
  if (tree.levels.length) addLevels(panel, tree);
  addScene(panel, stand, page);
  if (!tree.levels.length) return;
  addPruning(panel, tree, farthest);
  addByHand(panel, tree, page);
  if (tree.levels[0].wind) addWind(panel, tree);
  const fades = panel.addFolder("Fades").close();
  fades.add(tree.settings, "fadeBehindMorph", 0, 0.5).name("into clouds");
  fades.add(tree.settings, "fade", 0, 0.5).name("into the last level");
  fades.add(tree.settings, "hysteresis", 0, 0.2).name("delay on the way back");
}

/** The slider is logarithmic, in doublings of the crown radius, so that near and far are equally easy to set. */
function addDistance(panel, tree, { lookFrom }, farthest) {
  const state = {
    get distance() {
      return Math.log2(tree.distance / tree.radius);
    },
    set distance(doublings) {
      lookFrom(tree.radius * 2 ** doublings);
    },
  };
  const most = Math.log2(farthest / tree.radius);
  panel.add(state, "distance", 0, most).name("distance (doublings)").decimals(2).listen();
}

function addLevels(panel, tree) {
  const byDistance = "for the distance";
  const state = { level: tree.settings.level ?? byDistance };
  const names = [byDistance, ...tree.levels.map((_, number) => number)];
  const apply = (level) => (tree.settings.level = level === byDistance ? null : level);
  panel.add(state, "level", names).name("level").onChange(apply);
  panel.add(tree.settings, "lodDistance", 0.25, 4).name("LOD distance");
}

function addScene(panel, stand, { ground, light, moveSun, reachChanged }) {
  const folder = panel.addFolder("Scene").close();
  if (stand.tree.levels.length) {
    folder.add(stand, "count", COUNTS).name("trees").onChange(reachChanged);
    folder.add(stand, "beside").name("full tree beside").onChange(reachChanged);
  }
  folder.add(ground, "visible").name("ground");
  folder.add(light, "height", 0, 90).name("sun height (°)").onChange(moveSun);
  folder.add(light, "direction", 0, 360).name("sun direction (°)").onChange(moveSun);
}

function addPruning(panel, tree, farthest) {
  const { settings } = tree;
  const byHand = Number.isFinite(settings.pruneStart);
  const [asBaked, never, fromHere] = ["as baked", "never", "from this distance"];
  const unpruned = settings.pruneStart === null ? asBaked : never;
  const state = { prune: byHand ? fromHere : unpruned, start: byHand ? settings.pruneStart : tree.levels[0].handOver / 4 };
  const starts = { [asBaked]: () => null, [never]: () => Infinity, [fromHere]: () => state.start };
  const apply = () => (settings.pruneStart = starts[state.prune]());
  const folder = panel.addFolder("Fewer leaves with distance").close();
  folder.add(state, "prune", Object.keys(starts)).name("begin").onChange(apply);
  folder.add(state, "start", tree.radius, farthest / 4).name("this distance").onChange(apply);
  folder.add(settings, "pruneHalf", 0.01, 0.5).name("half of them at (share)").onChange(apply);
  folder.add(settings, "contrast").name("keep the contrast");
}

function addByHand(panel, tree, { wanted }) {
  const values = { transition: 0, keep: Number(wanted.get("keep")) || 1 };
  const state = { on: wanted.has("keep") };
  const apply = () => (tree.settings.byHand = state.on ? values : null);
  const folder = panel.addFolder("By hand").close();
  folder.add(state, "on").name("ignore distance").onChange(apply);
  folder.add(values, "transition", 0, 1).name("onto billboards (a)");
  folder.add(values, "keep", 0.005, 1).name("kept leaves (λ)");
  apply();
}

/** Starts at the strength in the file unless the settings have one. */
function addWind(panel, tree) {
  const state = { strength: tree.settings.wind ?? tree.levels[0].wind.strength };
  const folder = panel.addFolder("Wind").close();
  folder.add(state, "strength", 0, 20).onChange((strength) => (tree.settings.wind = strength));
}
