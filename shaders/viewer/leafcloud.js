// Trees with levels of detail in three.js: loads NAME.glb, and draws the level that the camera's distance asks for, morphed
// and pruned by the laws of ../leafcloud.glsl.
//
//     const tree = await Tree.load("NAME.glb");
//     scene.add(tree);
//     … before each picture: tree.update(camera, seconds);
//
// What the shaders need of a level are attributes of its geometry: lcTarget, lcRank, lcPivot, lcPivotTarget, and uniforms;
// where the file has wind, lcBillboardPivot, lcPhase and lcFreedom, too, and update(camera, seconds) says when it is.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { BlendOrder } from "./blending.js";
import { after, before, replaced } from "./patching.js";
import { addTangents, shadeItself, visibilityOf } from "./self_shadowing.js";

/** ../leafcloud.glsl, and after it what a vertex shader declares and where it puts a point. */
export const LAWS = await text(new URL("../leafcloud.glsl", import.meta.url));
const DECLARATIONS = `
uniform vec3 lcTransitionAt; // distance, start, end
uniform vec3 lcKeepAt; // distance, prune start, prune half
uniform float lcShares[LC_SHARES];
uniform vec2 lcGrowth;
in vec3 lcTarget;
in float lcRank;
in vec3 lcPivot;
in vec3 lcPivotTarget;

vec3 lcPlaced(vec3 point) {
    float transition = lc_transition(lcTransitionAt.x, lcTransitionAt.y, lcTransitionAt.z);
    float keep = lc_keep(lcKeepAt.x, lcKeepAt.y, lcKeepAt.z);
    float scale = lc_area_scale(keep, lcShares) * lc_trend(keep, lcGrowth);
    float growth = lc_growth(lcRank, keep, scale);
    return lc_place(point, lcTarget, lcPivot, lcPivotTarget, transition, growth);
}
`;

/** What a vertex shader declares beside that where the file has wind, for leaves and for wood. */
const WIND_DECLARATIONS = `
uniform LcWind lcWind;
in vec3 lcBillboardPivot;
in float lcPhase;
in float lcFreedom;

vec3 lcBlownLeaf(vec3 point) {
    float transition = lc_transition(lcTransitionAt.x, lcTransitionAt.y, lcTransitionAt.z);
    vec3 pivot = mix(lcPivot, lcPivotTarget, transition);
    vec3 turned = lc_flutter(lcPlaced(point), pivot, lcPhase, lcFreedom, transition, lcWind);
    return lc_blown(turned, lcPivot, lcBillboardPivot, transition, lcWind);
}
`;
const WOOD_DECLARATIONS = `
uniform LcWind lcWind;

vec3 lcBlownWood(vec3 point) {
    return lc_blown(point, point, point, 0.0, lcWind);
}
`;

const FRAGMENT_DECLARATIONS = `
uniform vec3 lcKeepAt;
uniform vec3 lcMean;
uniform vec2 lcContrast;
uniform float lcGrazing;
uniform float lcShare; // of the pixels that go to the next level, or
uniform bool lcNext; // of those that this level, which is the next, takes
in vec3 lcView;
`;
const FADE = `
    if (lc_shown(lcShare, gl_FragCoord.xy) != lcNext) discard;
    vec3 lcNormal = normalize(cross(dFdx(lcView), dFdy(lcView)));
    if (!lc_shown(lc_grazing(dot(lcNormal, normalize(lcView)), lcGrazing), gl_FragCoord.xy)) discard;
`;
const CONTRAST = `
    float lcKept = lc_keep(lcKeepAt.x, lcKeepAt.y, lcKeepAt.z);
    diffuseColor.rgb = lc_toward_mean(diffuseColor.rgb, lcMean, lc_contrast(lcKept, lcContrast));
`;

/** The a at which the next level takes over: at 1 itself leaves that overlap have next to no depth order left. */
const HAND_OVER = 0.998;

/**
 * How a tree is drawn. Distances are in the tree's own units.
 *
 * pruneStart: d₀ of the law of λ, for all levels alike; without end, nothing is pruned. null: each level as it was baked.
 * pruneHalf: h of that law, which goes with such a d₀.
 * fade: over which share of the distance at which it appears a level that nothing morphs to fades in.
 * fadeBehindMorph: the same of a level that the one before has morphed to: light, and the edges of alpha, are left to fade.
 * hysteresis: where nothing fades, by which share a level is drawn longer when the camera comes back, so that it does not
 *   switch to and fro.
 * grazing: billboards fade out from this |cos| between normal and view on; 0: they do not. null: as the file says.
 * wind: the strength of the wind, as of Blender's force fields; 0: nothing moves. null: as the file says. Files without wind
 *   have none.
 * contrast: whether the colours of leaves that are left are pulled toward their mean, as far as that was measured.
 * byHand: {transition, keep} in place of what the camera's distance asks for, at the level that it asks for.
 */
export const SETTINGS = {
  pruneStart: null,
  pruneHalf: 0.5,
  fade: 0.25,
  fadeBehindMorph: 0.1,
  hysteresis: 0.02,
  grazing: null,
  contrast: true,
  wind: null,
  byHand: null,
};

export class Tree extends THREE.Group {
  /** The tree in the file at `url`, at rest. */
  static async load(url) {
    const gltf = await new GLTFLoader().loadAsync(url);
    await addLevels(gltf);
    return new Tree(gltf, await visibilityOf(gltf));
  }

  constructor(gltf, visibility) {
    super();
    this.add(gltf.scene);
    this.settings = { ...SETTINGS };
    this.levels = levelsOf(gltf, visibility);
    this.level = 0;
    this.distance = 0;
    const { center, radius } = sphereOf(this.levels[0], this);
    this.centre = center;
    this.radius = radius;
    this.levels.forEach((level) => (level.object.visible = level === this.levels[0]));
  }

  /** Shows what the camera asks for, as the wind has it after so many seconds. */
  update(camera, seconds = 0) {
    const eye = camera.getWorldPosition(new THREE.Vector3());
    this.distance = this.worldToLocal(eye.clone()).distanceTo(this.centre);
    this.level = this.#levelAt(this.distance);
    const share = this.#shareOfNext();
    this.levels.forEach((level, number) => {
      const next = number === this.level + 1;
      level.object.visible = number === this.level || (next && share > 0);
      if (!level.object.visible) return;
      Object.assign(level.uniforms.lcShare, { value: share });
      Object.assign(level.uniforms.lcNext, { value: next });
      this.#move(level);
      level.blended.forEach((order) => order.update(eye));
      if (level.wind) this.#blow(level, seconds);
    });
  }

  /** a, λ of what is drawn, as the shaders have them. */
  get state() {
    const [transition, keep] = this.#laws(this.levels[this.level]);
    return { level: this.level, transition: transitionAt(...transition), keep: keepAt(...keep) };
  }

  #levelAt(distance) {
    const { levels } = this;
    let number = this.level;
    while (number + 1 < levels.length && distance >= this.#end(levels[number])) number++;
    while (number > 0 && distance < this.#end(levels[number - 1]) * (1 - this.#delay(levels[number - 1]))) number--;
    return number;
  }

  #fade(level) {
    return level.morphs ? this.settings.fadeBehindMorph : this.settings.fade;
  }

  /** From where the level is no longer drawn. */
  #end(level) {
    return level.handOver * (1 + this.#fade(level));
  }

  /** A fade has no need of it: it is the same to and fro. */
  #delay(level) {
    return this.#fade(level) > 0 ? 0 : this.settings.hysteresis;
  }

  /** Of the pixels, where the level that is drawn hands over. */
  #shareOfNext() {
    const level = this.levels[this.level];
    const fades = isFinite(level.handOver) && this.#fade(level) > 0;
    return fades ? transitionAt(this.distance, level.handOver, this.#end(level)) : 0;
  }

  /** What lc_transition and lc_keep are called with. */
  #laws({ start, end, pruning }) {
    const { pruneStart, pruneHalf, byHand } = this.settings;
    if (byHand) return [[byHand.transition, 0, 1], [1, byHand.keep, 0.5]];
    const [from, half] = pruneStart === null ? [pruning.start, pruning.half] : [pruneStart, pruneHalf];
    return [[this.distance, start, end], [this.distance, Math.min(from, NEVER), half]];
  }

  /** Where it blows to is told in the world; points are moved in their own coordinates. */
  #blow({ object, wind, uniforms }, seconds) {
    const strength = this.settings.wind ?? wind.strength;
    object.updateWorldMatrix(true, false);
    const place = new THREE.Vector3().setFromMatrixPosition(object.matrixWorld);
    const value = uniforms.lcWind.value;
    value.direction.fromArray(wind.direction).transformDirection(object.matrixWorld.clone().invert());
    value.force = strength / (Math.abs(strength) + 4);
    value.turns = seconds / wind.period + PLACE_TURNS.dot(place);
  }

  #move(level) {
    const [transition, keep] = this.#laws(level);
    level.uniforms.lcTransitionAt.value.fromArray(transition);
    level.uniforms.lcKeepAt.value.fromArray(keep);
    level.uniforms.lcContrast.value.fromArray(this.settings.contrast ? level.pruning.contrast : [0, 0]);
    level.uniforms.lcGrazing.value = level.number > 0 ? (this.settings.grazing ?? level.grazing) : 0;
    for (const { geometry, prefixes } of level.pruned) {
      const step = Math.min(Math.ceil(keepAt(...keep) * (prefixes.length - 1) + 1e-6), prefixes.length - 1);
      geometry.setDrawRange(0, 3 * prefixes[step]);
    }
  }
}

/** A distance that no camera reaches. */
const NEVER = 1e9;

/** LC_PLACE_TURNS of leafcloud.glsl. */
const PLACE_TURNS = new THREE.Vector3(0.1732, 0.2236, -0.1414);

/** clamp((d − start) / (end − start), 0, 1), as in leafcloud.glsl. */
function transitionAt(distance, start, end) {
  return Math.min(Math.max((distance - start) / Math.max(end - start, 1e-30), 0), 1);
}

/** min((d₀/d)^(log_h ½), 1), as in leafcloud.glsl. */
function keepAt(distance, start, half) {
  return (start / Math.max(distance, start)) ** (Math.log(0.5) / Math.log(half));
}

async function text(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status}`);
  return response.text();
}

/** Puts the levels beside the first one, on whose node `MSFT_lod` names them: they lie in no scene. */
async function addLevels({ scene, parser }) {
  const ids = parser.json.nodes.flatMap(({ extensions }) => extensions?.MSFT_lod?.ids ?? []);
  const behind = await Promise.all(ids.map((id) => parser.getDependency("node", id)));
  behind.forEach((level) => scene.add(level));
}

function levelsOf({ scene, parser }, visibility) {
  const found = objectsOf(scene).filter(({ userData }) => userData.leafcloud?.level !== undefined);
  if (found.length === 0) throw new Error("No levels: this file is not one that Leafcloud wrote.");
  if (!found[0].userData.leafcloud.centre) throw new Error("An older Leafcloud wrote this file: bake the tree again.");
  const byNumber = (a, b) => a.userData.leafcloud.level - b.userData.leafcloud.level;
  const levels = found.sort(byNumber).map((object) => newLevel(object, parser, visibility));
  levels.forEach((level, i) => {
    const switchDistance = levels[i + 1]?.object.userData.leafcloud.switch_distance ?? Infinity;
    level.handOver = level.morphs ? level.start + HAND_OVER * (level.end - level.start) : switchDistance;
  });
  return levels;
}

function newLevel(object, parser, visibility) {
  const { level, transition_start: start, transition_end: end, grazing = 0 } = object.userData.leafcloud;
  const morphs = Number.isFinite(end);
  const pruning = pruningOf(object.userData.leafcloud);
  const { wind = null } = object.userData.leafcloud;
  const uniforms = newUniforms(pruning, wind);
  const [pruned, blended] = [[], []];
  for (const mesh of objectsOf(object).filter(({ isMesh }) => isMesh)) {
    const table = tableOf(mesh, parser);
    if (table?.firstTexcoord) nameNumbers(mesh.geometry, table.firstTexcoord);
    const leaves = moves(mesh.geometry);
    if (wind) mesh.frustumCulled = false; // The wind moves what it likes.
    if (mesh.material.transparent) blended.push(new BlendOrder(mesh, table?.order ?? null));
    if (leaves) {
      addAttributes(mesh.geometry, wind);
      mesh.frustumCulled = false; // Leaves grow out of the bounds.
      mesh.morphTargetInfluences = mesh.morphTargetDictionary = undefined;
      if (table?.shares) uniforms.lcShares.value = table.shares;
      // What is blended has another order; there, pruned leaves are drawn without a size.
      if (table?.shares && !mesh.material.transparent) pruned.push({ geometry: mesh.geometry, prefixes: table.prefixes });
    }
    const shading = visibility.get(mesh.material);
    if (shading) addTangents(mesh.geometry);
    mesh.material = patched(mesh.material, uniforms, leaves, shading);
    // Mip levels would make the leaves' own textures thinner, and the first cloud, which keeps its coverage, a step.
    if (leaves && level === 0 && mesh.material.map) mesh.material.map.minFilter = THREE.LinearFilter;
  }
  const reach = morphs ? { start, end } : { start: NEVER, end: NEVER };
  return { number: level, object, morphs, ...reach, pruning, wind, grazing, uniforms, pruned, blended };
}

/** How a level was baked to be pruned, and what was measured of it; never, where its extras do not say. */
function pruningOf(extras) {
  return {
    start: extras.prune_start ?? Infinity,
    half: extras.prune_half ?? 0.5,
    growth: extras.growth ?? [0, 0],
    contrast: extras.contrast ?? [0, 0],
    mean: extras.mean_color ?? [0, 0, 0],
  };
}

function newUniforms({ growth, mean }, wind) {
  return {
    ...(wind && { lcWind: { value: newWind(wind) } }),
    lcTransitionAt: { value: new THREE.Vector3(0, NEVER, NEVER) },
    lcKeepAt: { value: new THREE.Vector3(0, NEVER, 0.5) },
    lcShares: { value: Array.from({ length: 65 }, (_, i) => (i / 64) ** 2) },
    lcGrowth: { value: new THREE.Vector2(...growth) },
    lcContrast: { value: new THREE.Vector2() },
    lcMean: { value: new THREE.Vector3(...mean) },
    lcGrazing: { value: 0 },
    lcShare: { value: 0 },
    lcNext: { value: false },
  };
}

/** LcWind of leafcloud.glsl, in still air. */
function newWind({ up, foot, height, spread, gusts, sway, branches, flutter }) {
  const [upward, standing] = [up, foot].map((vector) => new THREE.Vector3(...vector));
  const shape = { up: upward, foot: standing, height, spread, gusts, sway, branches, flutter };
  return { direction: new THREE.Vector3(1, 0, 0), ...shape, force: 0, turns: 0 };
}

function objectsOf(root) {
  const found = [];
  root.traverse((object) => found.push(object));
  return found;
}

function moves({ attributes, morphAttributes }) {
  return "_leaf_rank" in attributes || "_leaf_pivot" in attributes || "position" in morphAttributes;
}

/** The mesh's tables; from the file itself, for in `userData` a node's extras may replace its mesh's. */
function tableOf(mesh, parser) {
  const { meshes, primitives } = parser.associations.get(mesh);
  const extras = parser.json.meshes[meshes].extras?.leafcloud;
  if (!extras) return undefined;
  const { area_shares: shares, prefixes, blend_order: orders, first_texcoord: firstTexcoord } = extras;
  return { shares, prefixes: prefixes?.[primitives].triangles, order: orders?.[primitives], firstTexcoord };
}

/** What GLTFLoader calls the sets of texture coordinates. */
const SETS = ["uv", "uv1", "uv2", "uv3", "texcoord_4", "texcoord_5", "texcoord_6", "texcoord_7"];

/** At which places among the numbers of these sets the file has each attribute, counted from the first set that is not
 * for textures. */
const NUMBERS = {
  _leaf_rank: [0, 7, 11],
  _leaf_pivot: [1, 2, 3],
  _leaf_pivot_target: [4, 5, 6],
  _leaf_billboard_pivot: [8, 9, 10],
};

/** Makes the attributes that a file for engines without custom attributes has as texture coordinates. */
function nameNumbers(geometry, first) {
  const sets = SETS.slice(first).flatMap((name) => geometry.attributes[name] ?? []);
  const number = (vertex, place) => sets[place >> 1]?.getComponent(vertex, place % 2) ?? 0;
  for (const [name, places] of Object.entries(NUMBERS)) {
    if (places[0] >= 2 * sets.length) continue;
    const values = Float32Array.from({ length: places.length * geometry.attributes.position.count }, (_, i) =>
      number(Math.floor(i / places.length), places[i % places.length]),
    );
    geometry.setAttribute(name, new THREE.BufferAttribute(values, places.length));
  }
  SETS.slice(first).forEach((name) => geometry.deleteAttribute(name));
}

/** Names what the shaders read; where the file has no ranks, all leaves are protected. */
function addAttributes(geometry, wind) {
  const { position, _leaf_rank: rank, _leaf_pivot: pivot, _leaf_pivot_target: pivotTarget } = geometry.attributes;
  geometry.setAttribute("lcTarget", targetsOf(geometry));
  const ranks = (_, i) => (rank ? rank.getX(i) : -1);
  geometry.setAttribute("lcRank", new THREE.BufferAttribute(Float32Array.from({ length: position.count }, ranks), 1));
  geometry.setAttribute("lcPivot", pivot ?? position);
  geometry.setAttribute("lcPivotTarget", pivotTarget ?? pivot ?? position);
  if (wind) addWind(geometry, pivot ?? position);
  Object.keys(NUMBERS).forEach((name) => geometry.deleteAttribute(name));
}

/** What has no billboard to go to stays with its own pivot; only leaves flutter. */
function addWind(geometry, pivot) {
  const { position, _leaf_billboard_pivot: billboardPivot, _leaf_rank: own } = geometry.attributes;
  const column = (at) => new THREE.BufferAttribute(Float32Array.from({ length: position.count }, (_, i) => at(i)), 1);
  geometry.setAttribute("lcBillboardPivot", billboardPivot ?? pivot);
  geometry.setAttribute("lcPhase", column((i) => own?.getY(i) ?? 0));
  geometry.setAttribute("lcFreedom", column((i) => own?.getZ(i) ?? 0));
}

/** The morph target as places instead of offsets, as an attribute instead of a texture. */
function targetsOf(geometry) {
  const { position } = geometry.attributes;
  const [offsets] = geometry.morphAttributes.position ?? [];
  geometry.morphAttributes = {};
  if (!offsets) return position;
  return new THREE.BufferAttribute(position.array.map((value, i) => value + offsets.array[i]), 3);
}

/** About a level's leaves, without its wood, in the coordinates of `root`: distances are taken from its centre. */
function sphereOf({ object }, root) {
  root.updateWorldMatrix(true, true);
  const { centre, radius } = object.userData.leafcloud;
  const toRoot = root.matrixWorld.clone().invert().multiply(object.matrixWorld);
  return new THREE.Sphere(new THREE.Vector3(...centre), radius).applyMatrix4(toRoot);
}

/** A material of the level's own that includes the laws; with `shading` it shades itself. */
function patched(original, uniforms, leaves, shading) {
  const material = original.clone();
  material.forceSinglePass = true; // Else of what is blended all backs are drawn before all fronts.
  material.color.multiplyScalar(original.userData.leafcloud?.light_strength ?? 1);
  const wind = "lcWind" in uniforms;
  material.customProgramCacheKey = () => `leafcloud ${leaves} ${wind} ${Boolean(shading)}`;
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = vertexShader(shader.vertexShader, leaves, wind);
    shader.fragmentShader = fragmentShader(shader.fragmentShader, leaves);
    if (shading) shadeItself(shader, shading);
  };
  return material;
}

/** What a vertex shader declares that places `leaves`, or else wood, and in which expression it puts the point. */
export function placing(leaves, wind) {
  if (leaves && wind) return [LAWS + DECLARATIONS + WIND_DECLARATIONS, "lcBlownLeaf(position)"];
  if (leaves) return [LAWS + DECLARATIONS, "lcPlaced(position)"];
  return wind ? [LAWS + WOOD_DECLARATIONS, "lcBlownWood(position)"] : ["", "position"];
}

function vertexShader(source, leaves, wind) {
  const [declarations, place] = placing(leaves, wind);
  const placed =
    place === "position" ? source : replaced(source, "#include <begin_vertex>", `vec3 transformed = ${place};`);
  const seen = after("#include <project_vertex>", "lcView = -mvPosition.xyz;", placed);
  return before("void main()", `out vec3 lcView;\n${declarations}`, seen);
}

function fragmentShader(source, leaves) {
  const faded = after("#include <clipping_planes_fragment>", FADE, source);
  const shaded = leaves ? after("#include <color_fragment>", CONTRAST, faded) : faded;
  return before("void main()", LAWS + FRAGMENT_DECLARATIONS, shaded);
}
